// SPDX-License-Identifier: MIT
#include "tarsier/face/people/sighting_groups.h"

#include "tarsier/core/rng.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <stdexcept>

namespace tarsier::face::people {
namespace {

using recognition::Background;
using recognition::Rows;

const Background& general_background() {
  static const Background learned = recognition::synthetic_background();
  return learned;
}

const recognition::PairScores& pairs() {
  static const recognition::PairScores scores = recognition::pair_scores(general_background());
  return scores;
}

struct SyntheticSightings {
  std::vector<std::vector<float>> faces;
  std::vector<int> people;
};

// People with the background's scatter. Each image differs by `noise` times this scatter.
SyntheticSightings synthetic_sightings(int people, int images, double noise, std::uint64_t seed) {
  const Background& general = general_background();
  const Eigen::Index m = general.basis.rows();
  const Rng rng(seed);
  Rows coordinates(people * images, m + 1);
  SyntheticSightings out;
  for (int k = 0; k < images; ++k) {
    for (int p = 0; p < people; ++p) {
      Rng person = rng.fork(static_cast<std::uint64_t>(p));
      Rng image = rng.fork(static_cast<std::uint64_t>(1000 + p * images + k));
      const auto i = static_cast<Eigen::Index>(out.people.size());
      for (Eigen::Index c = 0; c < m; ++c)
        coordinates(i, c) = static_cast<float>(std::sqrt(general.variance(c)) *
                                               (person.normal() + noise * image.normal()));
      coordinates(i, m) = static_cast<float>(general.residual_variance);
      out.people.push_back(p);
    }
  }
  const Rows rows = recognition::templates_of_coordinates(pairs().model, general, coordinates);
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    out.faces.emplace_back(rows.row(i).data(), rows.row(i).data() + rows.cols());
  return out;
}

// The final group of each sighting.
class Log {
 public:
  void note(std::size_t sighting, const GroupAssignment& assignment) {
    for (const auto& [from, into] : assignment.merged)
      for (auto& [other, group] : of)
        if (group == from) group = into;
    of[sighting] = assignment.group;
  }
  std::map<std::size_t, std::int64_t> of;
};

double purity(const Log& log, const std::vector<int>& people) {
  std::map<std::int64_t, std::map<int, int>> counts;
  for (const auto& [sighting, group] : log.of) ++counts[group][people[sighting]];
  int right = 0;
  for (const auto& [group, of] : counts)
    right += std::max_element(of.begin(), of.end(), [](const auto& a, const auto& b) {
               return a.second < b.second;
             })->second;
  return right / static_cast<double>(log.of.size());
}

TEST(SightingGroups, GroupsSightingsOfTwentyPeople) {
  const SyntheticSightings seen = synthetic_sightings(20, 10, 0.5, 7);
  SightingGroups groups(pairs(), {});
  Log log;
  for (std::size_t i = 0; i < seen.faces.size(); ++i)
    log.note(i, groups.add(seen.faces[i], 0.3 + 0.07 * static_cast<double>(i % 10)));
  EXPECT_LE(groups.size(), 24U);
  EXPECT_GE(groups.size(), 20U);
  EXPECT_GE(purity(log, seen.people), 0.97);
}

// Strangers who are seen once each. Groups of two are wrong and must be as rare as stated.
TEST(SightingGroups, FalseMergeRateIsBelowTheStatedRate) {
  const SyntheticSightings seen = synthetic_sightings(100, 1, 0.5, 11);
  GroupingOptions options;
  options.false_merges = 0.001;
  SightingGroups groups(pairs(), options);
  for (const auto& face : seen.faces) (void)groups.add(face, 1);
  // 4950 pairs, of which about five may be wrong.
  EXPECT_GE(groups.size(), 90U);
}

// One run, and a run with a restart after each sighting: the same groups with the same ids, bit for
// bit.
TEST(SightingGroups, RestartsDoNotChangeTheGroups) {
  const SyntheticSightings seen = synthetic_sightings(8, 6, 0.8, 3);
  SightingGroups whole(pairs(), {});
  Log at_once;
  Log with_restarts;
  std::int64_t next = 1;
  for (std::size_t i = 0; i < seen.faces.size(); ++i) {
    const double quality = 0.2 + 0.1 * static_cast<double>(i % 7);
    at_once.note(i, whole.add(seen.faces[i], quality));
    SightingGroups restarted(pairs(), {});
    // Restored in another order.
    for (std::size_t k = i; k-- > 0;)
      restarted.restore(with_restarts.of[k], seen.faces[k], 0.2 + 0.1 * static_cast<double>(k % 7));
    restarted.set_next(next);
    with_restarts.note(i, restarted.add(seen.faces[i], quality));
    next = restarted.next();
    ASSERT_EQ(at_once.of, with_restarts.of) << i;
    ASSERT_EQ(next, whole.next());
    EXPECT_EQ(whole.threshold(), restarted.threshold());
  }
}

TEST(SightingGroups, KeepsIdsAndCannotLinkPairs) {
  const SyntheticSightings seen = synthetic_sightings(2, 4, 0.2, 5);
  SightingGroups groups(pairs(), {});
  EXPECT_EQ(groups.add(seen.faces[0], 1).group, 1);
  EXPECT_EQ(groups.add(seen.faces[1], 1).group, 2);
  EXPECT_EQ(groups.add(seen.faces[2], 1).group, 1);
  EXPECT_EQ(groups.add(seen.faces[3], 1).group, 2);
  EXPECT_LT(groups.score(1, 2), groups.threshold());
  // A user said that this group of the first person is another person.
  SightingGroups corrected(pairs(), {});
  corrected.restore(1, seen.faces[0], 1);
  corrected.restore(2, seen.faces[2], 1);
  corrected.add_cannot_link(1, 2);
  EXPECT_GE(corrected.score(1, 2), corrected.threshold());
  const GroupAssignment assignment = corrected.add(seen.faces[4], 1);
  EXPECT_TRUE(assignment.merged.empty());
  EXPECT_EQ(corrected.size(), 2U);
  // Without that correction, the sighting shows that both groups are one person.
  SightingGroups free(pairs(), {});
  free.restore(4, seen.faces[0], 1);
  free.restore(9, seen.faces[2], 1);
  const GroupAssignment joined = free.add(seen.faces[4], 1);
  EXPECT_EQ(joined.group, 4);
  ASSERT_EQ(joined.merged.size(), 1U);
  EXPECT_EQ(joined.merged.front(), std::pair(std::int64_t{9}, std::int64_t{4}));
  EXPECT_EQ(free.next(), 10);
}

// A sharp face moves the group's mean more than a blurred one.
TEST(SightingGroups, QualityWeightsTheMean) {
  const SyntheticSightings seen = synthetic_sightings(2, 2, 0.8, 5);
  SightingGroups sharp(pairs(), {});
  SightingGroups blurred(pairs(), {});
  for (SightingGroups* groups : {&sharp, &blurred}) {
    groups->restore(1, seen.faces[0], 0.5);
    groups->restore(2, seen.faces[2], 0.5);
    groups->restore(1, seen.faces[1], groups == &sharp ? 1 : 0.1);
  }
  EXPECT_LT(sharp.score(1, 2), blurred.score(1, 2));
}

TEST(SightingGroups, RejectsInvalidTemplates) {
  const SyntheticSightings seen = synthetic_sightings(1, 1, 0.2, 5);
  SightingGroups groups(pairs(), {});
  EXPECT_THROW((void)groups.add(std::vector<float>(3), 1), std::invalid_argument);
  std::vector<float> broken = seen.faces[0];
  broken[0] = NAN;
  EXPECT_THROW((void)groups.add(broken, 1), std::invalid_argument);
  EXPECT_THROW((void)groups.add(seen.faces[0], NAN), std::invalid_argument);
  EXPECT_EQ(groups.size(), 0U);
  EXPECT_THROW(groups.restore(0, seen.faces[0], 1), std::invalid_argument);
  GroupingOptions options;
  options.false_merges = 0.7;
  EXPECT_THROW((SightingGroups{pairs(), options}), std::invalid_argument);
  recognition::PairScores bare = pairs();
  bare.model.calibration.reset();
  EXPECT_THROW((SightingGroups{bare, {}}), std::invalid_argument);
  // Faces without any information are similar to nobody, also not to each other.
  const std::vector<float> nothing(seen.faces[0].size(), 0.0F);
  (void)groups.add(nothing, 1);
  (void)groups.add(nothing, 1);
  EXPECT_EQ(groups.size(), 2U);
}

// nearest_group() returns the group of a face without adding the face.
TEST(SightingGroups, NearestGroupAgreesWithAdd) {
  const SyntheticSightings seen = synthetic_sightings(8, 6, 0.35, 11);
  SightingGroups groups(pairs(), {});
  EXPECT_EQ(groups.nearest_group(seen.faces[0], 1), 0);
  int compared = 0;
  for (std::size_t i = 0; i < seen.faces.size(); ++i) {
    const std::int64_t nearest = groups.nearest_group(seen.faces[i], 0.8);
    const std::size_t before = groups.size();
    SightingGroups copy = groups;
    const GroupAssignment assignment = groups.add(seen.faces[i], 0.8);
    EXPECT_EQ(nearest == 0, assignment.is_new) << i;
    if (nearest != 0 && assignment.merged.empty()) {
      EXPECT_EQ(nearest, assignment.group) << i;
      ++compared;
    }
    EXPECT_EQ(copy.size(), before);
  }
  EXPECT_GT(compared, 20);
  EXPECT_THROW((void)groups.nearest_group(std::vector<float>(3, 0.F), 1), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::people
