// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/recognition/pair_scores.h"

#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <utility>
#include <vector>

// Groups sightings of unknown faces by person. The groups grow as sightings arrive.
namespace tarsier::face::people {

inline constexpr double kDeepFalseMergeRate = 0.005;
inline constexpr double kClassicFalseMergeRate = 0.05;
// For classic templates before a second pass (group_merging.h), which needs pure groups.
inline constexpr double kFirstPassFalseMergeRate = 0.005;

struct GroupingOptions {
  // 0: kDeepFalseMergeRate or kClassicFalseMergeRate; group_sightings() then makes two passes for
  // many classic templates.
  double false_merges = 0;

  [[nodiscard]] OptionFields fields() {
    return {{"false_merges", false_merges, range(0, 0.5), "--false-merges",
             "share of impostor pairs merged by mistake; 0: 0.005 for deep, 0.05 for classic "
             "templates"}};
  }
  void check() const { check_fields(*this); }
};

// The group of a new sighting.
struct GroupAssignment {
  std::int64_t group = 0;
  bool is_new = false;
  // Groups that were merged because of this sighting: the first into the second, in this order.
  std::vector<std::pair<std::int64_t, std::int64_t>> merged;
};

// Incremental agglomerative clustering. Each sighting starts as a group of its own. Then the
// changed group is merged with the most similar group as long as their score reaches the threshold;
// the older id is kept. With the templates x_i (directions of unit length or less), weights w_i
// (their quality) and m_g the weighted mean of a group,
//
//   v_g = m_g - sum_h m_h / (G + W)        G groups, W the background's weight: removes what all
//                                          groups have in common (same camera, same light)
//   r_g = |v_g| / (weighted mean of |x_i|) 1 for one sighting, less for more diverse groups
//   s(g, h) = v_g . v_h / sqrt(r_g r_h)
//
// v_g . v_h is the mean score of all pairs (average linkage, Sokal and Michener 1958). v_g . v_h /
// (r_g r_h) is the score of the two pooled templates (Recognizer, pooled()). s is the geometric
// mean of both. For strangers, the spread of the first falls with the group size and that of the
// second rises, so that a threshold for pairs holds for groups of all sizes. The threshold is that
// of PairScores at the rate `false_merges`, minus the share of the same-camera shift that v has
// already removed.
//
// The result depends only on the sightings and their order: sums are integers. It is the same for
// any batch size, after a restart, and with any number of threads.
class SightingGroups {
 public:
  // Throws std::invalid_argument.
  SightingGroups(const recognition::PairScores& pairs, const GroupingOptions& options);

  // Adds a sighting of an existing group. `quality` 0..1.
  void restore(std::int64_t group, std::span<const float> features, double quality);
  // Two groups that show different people, whatever their score.
  void add_cannot_link(std::int64_t a, std::int64_t b);
  // The id of the next group, greater than all existing ones.
  void set_next(std::int64_t id);
  [[nodiscard]] std::int64_t next() const { return next_; }

  // Throws std::invalid_argument for a template of another length or with values that are not
  // finite.
  GroupAssignment add(std::span<const float> features, double quality);
  // The group that add() would merge it with first; 0: no group is similar enough. Throws as add().
  [[nodiscard]] std::int64_t nearest_group(std::span<const float> features, double quality) const;

  [[nodiscard]] std::size_t size() const { return groups_.size(); }
  // The score of two groups, and the current threshold of it. Throws std::out_of_range.
  [[nodiscard]] double score(std::int64_t a, std::int64_t b) const;
  [[nodiscard]] double threshold() const;

 private:
  struct Group {
    std::vector<std::int64_t> sum;  // of weight * template, fixed point
    std::int64_t weight = 0;
    std::int64_t norm = 0;     // of weight * |template|, fixed point
    std::vector<double> mean;  // derived
    std::set<std::int64_t> cannot_link;
  };
  void accumulate(Group& group, std::span<const float> features, double quality) const;
  static void update_mean(Group& group);
  // The common part of all groups, including `more`, which may be null.
  [[nodiscard]] std::vector<double> common_mean(const Group* more = nullptr) const;
  [[nodiscard]] double threshold(std::size_t groups) const;
  [[nodiscard]] double score(const Group& a, const Group& b,
                             const std::vector<double>& common_mean) const;
  void merge(std::int64_t from, std::int64_t into);

  std::size_t template_length_;
  double threshold_ = 0;  // for pairs
  double same_camera_;
  double background_weight_;
  std::map<std::int64_t, Group> groups_;
  std::int64_t next_ = 1;
};

}  // namespace tarsier::face::people
