// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/recognition/recognizer.h"

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

// Finds groups that show the same person. The variation within groups, such as light and head
// rotation, is learned from the groups themselves.
namespace tarsier::face::people {

struct GroupMergingOptions {
  // Threshold for merging two groups: deviations of strangers' scores above their median.
  double deviations = 4;
  // Added to the variances within groups, in units of their mean.
  double floor = 1;
  // With fewer groups, the scores of strangers cannot be estimated.
  int min_groups = 10;
  // With fewer sightings besides the first of each group, the variation within people cannot be
  // estimated.
  int min_pairs = 20;
  // Only the groups with most sightings are used.
  int max_groups = 4000;

  [[nodiscard]] OptionFields fields() {
    return {{"deviations", deviations, range(0, 100)},
            {"floor", floor, range(0.001, 1000)},
            {"min_groups", min_groups, range(2, 1'000'000)},
            {"min_pairs", min_pairs, range(1, 1'000'000)},
            {"max_groups", max_groups, range(2, 20'000)}};
  }
  void check() const { check_fields(*this); }
};

// Max number of sightings used per group.
inline constexpr int kMaxSightingsPerGroup = 20;

// Templates of sightings (one per row, at most kMaxSightingsPerGroup) by group.
using GroupTemplates = std::map<std::int64_t, recognition::Rows>;
using GroupPairs = std::vector<std::pair<std::int64_t, std::int64_t>>;

// One round of merging. S is the scatter within groups (of all sightings about the mean of their
// group), with eigenvalues e_k, their mean m and eigenvectors V. Sightings x become directions
//
//   y = T (x - c) / |T (x - c)|,   T = V diag(1 / sqrt(e_k + floor m)) V'
//
// (within-class covariance normalisation: Hatch and Stolcke, "Generalized linear kernels for
// one-versus-all classification", ICASSP 2006; here learned from the groups themselves). c is the
// mean of the groups' means. A score is y . y'. Scores of sightings of different groups, at most
// five of each, have a median and a deviation (1.4826 times the median absolute one); nearly all of
// them are of strangers. The two groups with the highest mean score are merged (average linkage) as
// long as it is `deviations` above that median.
//
// Returns the merges in order, the younger group into the older. Groups in `cannot_link` (pairs,
// smaller id first), and those merged with them, are not merged. Empty if there are fewer groups or
// sightings than the options require. Throws std::invalid_argument for templates of different
// lengths or bad options.
[[nodiscard]] std::optional<GroupPairs> find_group_merges(
    const GroupTemplates& groups,
    const std::set<std::pair<std::int64_t, std::int64_t>>& cannot_link,
    const GroupMergingOptions& options = {});

}  // namespace tarsier::face::people
