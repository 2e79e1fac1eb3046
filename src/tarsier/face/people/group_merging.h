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

// Groups that show one person, found by what differs within groups: the light, the turn of the head.
namespace tarsier::face::people {

struct GroupMergingOptions {
  // Of strangers' scores above their median, from which two groups are one person.
  double deviations = 4;
  // Of the variances within groups, in their mean.
  double floor = 1;
  // Fewer groups say too little of strangers.
  int min_groups = 10;
  // Fewer sightings beside the first of each group say too little of what one person varies by.
  int min_pairs = 20;
  // Those with most sightings take part.
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

// Sightings of a group that are used, at most.
inline constexpr int kMergingSightings = 20;

// Templates of sightings (a row each, at most kMergingSightings) by the group that they are in.
using GroupTemplates = std::map<std::int64_t, recognition::Rows>;
using GroupPairs = std::vector<std::pair<std::int64_t, std::int64_t>>;

// One round. With the scatter within groups S (of all sightings about the mean of their group),
// its eigenvalues e_k, eigenvectors V and their mean value m, sightings x become directions
//
//   y = T (x - c) / |T (x - c)|,   T = V diag(1 / sqrt(e_k + floor m)) V'
//
// (within-class covariance normalisation: Hatch and Stolcke, "Generalized linear kernels for
// one-versus-all classification", ICASSP 2006, here learned from the groups themselves), c the mean of the
// groups' means. A score is y . y'. The scores of sightings of different groups, at most five of each, have
// a median and a deviation (1.4826 times the median absolute one): nearly all are of strangers. The two groups whose
// mean score is the highest become one (average linkage) as long as it is `deviations` above that
// median. Returned are the merges in order, the younger group into the older; groups in `apart`
// (pairs, smaller id first), and those merged with them, stay apart. Nothing where there are fewer groups or
// sightings than the options ask for. Throws std::invalid_argument for templates of different lengths or bad options.
[[nodiscard]] std::optional<GroupPairs> alike_groups(
    const GroupTemplates& groups, const std::set<std::pair<std::int64_t, std::int64_t>>& apart,
    const GroupMergingOptions& options = {});

}  // namespace tarsier::face::people
