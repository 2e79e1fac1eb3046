// SPDX-License-Identifier: MIT
#include "tarsier/face/people/group_merging.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>

namespace tarsier::face::people {
namespace {

using recognition::Rows;

constexpr int kLength = 48;

// A direction per person, and one common direction of variation (a lamp at one side or the other).
// The latter is as strong as the difference between people.
class SyntheticPeople {
 public:
  explicit SyntheticPeople(std::uint64_t seed) : rng_(seed) {}

  [[nodiscard]] Rows sightings(int person, int count, double light) const {
    Rows out(count, kLength);
    Rng who = rng_.fork(static_cast<std::uint64_t>(person));
    Eigen::RowVectorXf face(kLength);
    for (int k = 0; k < kLength; ++k) face(k) = static_cast<float>(who.normal());
    for (int i = 0; i < count; ++i) {
      Rng one =
          rng_.fork(static_cast<std::uint64_t>(1000 + 100 * person + 10 * i + (light > 0 ? 1 : 0)));
      out.row(i) = face;
      for (int k = 0; k < kLength; ++k) out(i, k) += static_cast<float>(0.3 * one.normal());
      out(i, 0) += static_cast<float>(light + 0.5 * light * one.normal());
      out.row(i).normalize();
    }
    return out;
  }

 private:
  Rng rng_;
};

// Two groups of each person, in different light: 2p + 1 and 2p + 2.
GroupTemplates two_groups_per_person(const SyntheticPeople& people, int person_count,
                                     int count = 3) {
  GroupTemplates groups;
  for (int p = 0; p < person_count; ++p) {
    groups.emplace(2 * p + 1, people.sightings(p, count, 6));
    groups.emplace(2 * p + 2, people.sightings(p, count, -6));
  }
  return groups;
}

TEST(GroupMerging, LearnsTheVariationWithinGroups) {
  const SyntheticPeople people(4);
  const GroupTemplates groups = two_groups_per_person(people, 12);
  // Raw templates: a person in other light is less similar than another person in the same light.
  const double self = groups.at(1).row(0).dot(groups.at(2).row(0));
  const double other = groups.at(1).row(0).dot(groups.at(3).row(0));
  EXPECT_LT(self, other);
  const auto merged = find_group_merges(groups, {});
  ASSERT_TRUE(merged);
  std::set<std::pair<std::int64_t, std::int64_t>> found(merged->begin(), merged->end());
  for (const auto& [from, into] : found) {
    EXPECT_EQ(into % 2, 1);
    EXPECT_EQ(from, into + 1);
  }
  EXPECT_GE(found.size(), 11U);
  EXPECT_EQ(find_group_merges(groups, {}), merged);
}

TEST(GroupMerging, DoesNotMergeDifferentPeople) {
  const SyntheticPeople people(9);
  GroupTemplates groups;
  for (int p = 0; p < 60; ++p) groups.emplace(p + 1, people.sightings(p, 3, p % 2 == 0 ? 6 : -6));
  const auto merged = find_group_merges(groups, {});
  ASSERT_TRUE(merged);
  EXPECT_TRUE(merged->empty());
}

TEST(GroupMerging, RespectsCannotLinkPairs) {
  const SyntheticPeople people(4);
  GroupTemplates groups = two_groups_per_person(people, 12);
  groups.emplace(30, people.sightings(0, 1, 6));
  const auto free = find_group_merges(groups, {});
  const auto kept = find_group_merges(groups, {{1, 2}});
  ASSERT_TRUE(free && kept);
  const auto count_of_first = [](const GroupPairs& merged) {
    std::map<std::int64_t, std::int64_t> in{{1, 1}, {2, 2}, {30, 30}};
    for (const auto& [from, into] : merged)
      for (auto& [id, group] : in)
        if (group == from) group = into;
    std::set<std::int64_t> left;
    for (const auto& [id, group] : in) left.insert(group);
    return left.size();
  };
  EXPECT_EQ(count_of_first(*free), 1U);
  // 30 is merged with one of them; so it stays apart from the other
  EXPECT_EQ(count_of_first(*kept), 2U);
}

TEST(GroupMerging, ReturnsNothingForTooFewData) {
  const SyntheticPeople people(4);
  EXPECT_FALSE(find_group_merges({}, {}));
  EXPECT_FALSE(find_group_merges(two_groups_per_person(people, 4), {}));  // 8 groups
  EXPECT_FALSE(
      find_group_merges(two_groups_per_person(people, 12, 1), {}));  // no variation within groups
  EXPECT_TRUE(find_group_merges(two_groups_per_person(people, 6, 3), {}));
  GroupTemplates broken = two_groups_per_person(people, 6, 3);
  broken[99] = Rows::Zero(1, kLength + 1);
  EXPECT_THROW((void)find_group_merges(broken, {}), std::invalid_argument);
  broken[99] = Rows::Zero(kMaxSightingsPerGroup + 1, kLength);
  EXPECT_THROW((void)find_group_merges(broken, {}), std::invalid_argument);
  GroupMergingOptions options;
  options.floor = 0;
  EXPECT_THROW((void)find_group_merges(two_groups_per_person(people, 6), {}, options),
               std::invalid_argument);
}

TEST(GroupMerging, UsesTheLargestGroupsOnly) {
  const SyntheticPeople people(4);
  GroupTemplates groups = two_groups_per_person(people, 12);
  for (int p = 100; p < 140; ++p) groups.emplace(p, people.sightings(p, 1, 6));
  groups.emplace(200, people.sightings(0, 1, 6));  // of the first person
  GroupMergingOptions options;
  options.max_groups = 24;
  const auto merged = find_group_merges(groups, {}, options);
  ASSERT_TRUE(merged);
  EXPECT_GE(merged->size(), 10U);
  for (const auto& [from, into] : *merged) EXPECT_LT(from, 100);
}

}  // namespace
}  // namespace tarsier::face::people
