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

// Which sightings of unknown faces show one person: groups that grow as sightings come.
namespace tarsier::face::people {

inline constexpr double kDeepMerges = 0.005;
inline constexpr double kClassicMerges = 0.05;
// Of classic templates before a second pass (group_merging.h): what it begins with must be pure.
inline constexpr double kFirstPassMerges = 0.005;

struct GroupingOptions {
  // 0: kDeepMerges or kClassicMerges; group_sightings() of many classic templates makes two passes then.
  double false_merges = 0;

  [[nodiscard]] OptionFields fields() {
    return {{"false_merges", false_merges, range(0, 0.5), "--false-merges",
             "share of pairs of strangers that may be taken for one person; 0: 0.005 of deep, 0.05 "
             "of classic templates, and a second pass over these from 60 faces on"}};
  }
  void check() const { check_fields(*this); }
};

// Where a sighting went.
struct Placement {
  std::int64_t group = 0;
  bool is_new = false;
  // Groups that this sighting showed to be of one person: the first became part of the second, in
  // this order.
  std::vector<std::pair<std::int64_t, std::int64_t>> merged;
};

// Agglomerative clustering, one sighting at a time. A sighting is a group of its own, then the two
// groups of which one has just changed and that are most alike become one, as long as their score
// reaches the threshold; the older one's id stays. With the templates x_i (directions of unit
// length or less), weights w_i (their quality) and m_g the weighted mean of a group,
//
//   v_g = m_g - sum_h m_h / (G + W)        G groups, W the background's weight: what all have in
//                                          common (one camera, one light) is taken out
//   r_g = |v_g| / (weighted mean of |x_i|) 1 for one sighting, less the more a group's differ
//   s(g, h) = v_g . v_h / sqrt(r_g r_h)
//
// v_g . v_h is the mean score of all pairs (average linkage, Sokal and Michener 1958), and
// v_g . v_h / (r_g r_h) that of two pooled templates (Recognizer, pooled()); s is the geometric mean
// of both. Of strangers the one spreads less the larger the groups are, the other more, so that a
// threshold for pairs holds for groups of all sizes. It is that of
// PairScores at the rate `false_merges`, less the share of the same camera's part that v has taken
// out.
//
// What is computed depends on the sightings and their order alone: sums are of integers, so they
// are the same in whatever batches sightings come, after a restart, and with any number of threads.
class SightingGroups {
 public:
  // Throws std::invalid_argument.
  SightingGroups(const recognition::PairScores& pairs, const GroupingOptions& options);

  // A sighting of a group that is known from before. `quality` 0..1.
  void restore(std::int64_t group, std::span<const float> features, double quality);
  // Two groups that are of different people, whatever their score.
  void keep_apart(std::int64_t a, std::int64_t b);
  // The id of the next group, > all of before.
  void set_next(std::int64_t id);
  [[nodiscard]] std::int64_t next() const { return next_; }

  // Throws std::invalid_argument for a template of another length or that is not finite.
  Placement add(std::span<const float> features, double quality);
  // The group that add() would compare it with and take it for first; 0: none is like it enough.
  // Throws as add().
  [[nodiscard]] std::int64_t nearest_group(std::span<const float> features, double quality) const;

  [[nodiscard]] std::size_t size() const { return groups_.size(); }
  // Score of two groups, and the one that it must reach now. Throws std::out_of_range.
  [[nodiscard]] double score(std::int64_t a, std::int64_t b) const;
  [[nodiscard]] double threshold() const;

 private:
  struct Group {
    std::vector<std::int64_t> sum;  // of weight * template, fixed point
    std::int64_t weight = 0;
    std::int64_t length = 0;   // of weight * |template|, fixed point
    std::vector<double> mean;  // derived
    std::set<std::int64_t> apart;
  };
  void put(Group& group, std::span<const float> features, double quality) const;
  static void derive(Group& group);
  // What all groups have in common, and `more` with them, which may be null.
  [[nodiscard]] std::vector<double> common(const Group* more = nullptr) const;
  [[nodiscard]] double threshold(std::size_t groups) const;
  [[nodiscard]] double score(const Group& a, const Group& b,
                             const std::vector<double>& common) const;
  void join(std::int64_t from, std::int64_t into);

  std::size_t length_;
  double threshold_;  // of pairs
  double same_camera_;
  double background_weight_;
  std::map<std::int64_t, Group> groups_;
  std::int64_t next_ = 1;
};

}  // namespace tarsier::face::people
