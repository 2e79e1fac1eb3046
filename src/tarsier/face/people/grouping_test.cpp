// SPDX-License-Identifier: MIT
#include "tarsier/face/people/grouping.h"

#include "tarsier/face/people/group_merging.h"
#include "tarsier/face/people/testing_gallery.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <map>

namespace tarsier::face::people {
namespace {

using ::testing::SizeIs;

// Learned from the people who are seen. The random textures of other people have little in common
// with theirs.
const recognition::Background& background_of_the_seen() {
  static const recognition::Background learned = [] {
    const auto many = recognition::synthetic_faces(40, 2, 0.2, 3, 0, {128, 160});
    recognition::BackgroundOptions options;
    options.components = 60;
    NoProgress progress;
    return recognition::learn_background(many.faces, options, progress, {});
  }();
  return learned;
}

class GroupingTest : public FolderTest {
 protected:
  // Adds sightings of unknown people: one image of each person in turn.
  static void see(Gallery& gallery, int people, int first_image, int images) {
    const auto set =
        recognition::synthetic_faces(people, images + first_image, 0.2, 5, 0, {128, 160});
    for (int k = first_image; k < first_image + images; ++k) {
      for (int p = 0; p < people; ++p) {
        const SightingFace face{set.faces[static_cast<std::size_t>(p * (images + first_image) + k)],
                                0.9, "{}"};
        ASSERT_GT(gallery.add_sighting(1000 * k + p, "camera", "", false, 0, &face), 0);
      }
    }
  }
  GroupingReport group(Gallery& gallery) {
    return group_sightings(gallery, background_of_the_seen(), {}, progress_, {});
  }
  static std::map<std::int64_t, std::int64_t> group_of_sightings(Gallery& gallery) {
    std::map<std::int64_t, std::int64_t> out;
    for (const Sighting& sighting : gallery.sightings()) out[sighting.id] = sighting.group;
    return out;
  }
  NoProgress progress_;
};

TEST_F(GroupingTest, DoesNotDependOnBatchesAndThreads) {
  Gallery one(path("one.db"));
  see(one, 6, 0, 4);
  const GroupingReport report = group(one);
  EXPECT_EQ(report.assigned, 24);
  EXPECT_EQ(report.groups, 6);
  EXPECT_EQ(report.new_groups, 6);
  for (const SightingGroup& of : one.groups()) EXPECT_EQ(of.sightings, 4);
  EXPECT_EQ(group(one).assigned, 0);

  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  Gallery many(path("many.db"));
  for (int k = 0; k < 4; ++k) {
    see(many, 6, k, 1);
    EXPECT_EQ(group(many).assigned, 6);
  }
  cv::setNumThreads(threads);
  // The images of the two galleries differ, since their random numbers depend on the number in the
  // set. So only the groupings are compared.
  EXPECT_EQ(group_of_sightings(one), group_of_sightings(many));
}

// Enough sightings for two passes: the groups of the first pass are merged, and split groups stay
// apart.
TEST_F(GroupingTest, SecondPassMergesManySightings) {
  Gallery gallery(path("many.db"));
  see(gallery, 12, 0, 6);
  GroupingOptions strict;
  strict.false_merges = kFirstPassFalseMergeRate;
  Gallery once(path("once.db"));
  see(once, 12, 0, 6);
  const GroupingReport first =
      group_sightings(once, background_of_the_seen(), strict, progress_, {});
  const GroupingReport report = group(gallery);
  EXPECT_EQ(report.assigned, 72);
  EXPECT_EQ(report.groups, 12);
  EXPECT_EQ(report.new_groups, 12);
  EXPECT_GE(first.groups, report.groups);
  for (const SightingGroup& of : gallery.groups()) EXPECT_EQ(of.sightings, 6);
  EXPECT_EQ(group(gallery).merged, 0);  // nothing is left to merge
  // Splits the second sighting of the first group from this group: they are different people now.
  const std::int64_t taken = gallery.group_sightings(1).at(1).id;
  (void)gallery.split_group(1, std::vector<std::int64_t>{taken}, {1, "me"});
  see(gallery, 12, 6, 1);
  EXPECT_EQ(group(gallery).groups, 13);
}

TEST_F(GroupingTest, StoreMergesRejectsAChangedGallery) {
  Gallery gallery(path("p.db"));
  see(gallery, 3, 0, 2);
  (void)group(gallery);
  const std::int64_t generation = gallery.group_generation();
  const GroupPairs gone{{9, 1}};
  EXPECT_FALSE(gallery.store_merges(gone, generation));
  const GroupPairs chain{{3, 2}, {2, 1}};
  EXPECT_FALSE(gallery.store_merges(chain, generation - 1));
  ASSERT_THAT(gallery.groups(), SizeIs(3));
  EXPECT_TRUE(gallery.store_merges(chain, generation));
  ASSERT_THAT(gallery.groups(), SizeIs(1));
  EXPECT_EQ(gallery.groups().front().id, 1);
  EXPECT_EQ(gallery.groups().front().sightings, 6);
}

// Two programs group at the same time: the second does not revive a group that the first merged.
TEST_F(GroupingTest, GroupingRejectsTheStateBeforeAnotherGrouping) {
  Gallery gallery(path("p.db"));
  see(gallery, 2, 0, 2);
  (void)group(gallery);
  ASSERT_THAT(gallery.groups(), SizeIs(2));
  see(gallery, 1, 2, 2);
  const std::vector<std::int64_t> pending = gallery.ungrouped();
  ASSERT_THAT(pending, SizeIs(2));
  const std::int64_t before = gallery.group_generation();
  ASSERT_TRUE(gallery.store_merges(GroupPairs{{2, 1}}, before));
  EXPECT_EQ(gallery.group_generation(), before + 1);
  using Assignments = std::vector<Gallery::SightingAssignment>;
  EXPECT_FALSE(gallery.store_assignments(Assignments{{pending[0], 2, {}}}, 3, before));
  EXPECT_FALSE(gallery.group(2));
  EXPECT_TRUE(gallery.store_assignments(Assignments{{pending[0], 1, {}}}, 3, before + 1));
  EXPECT_FALSE(gallery.store_assignments(Assignments{{pending[1], 1, {}}}, 3, before + 1));
  // Retention counts, too.
  const std::int64_t grouped = gallery.group_generation();
  EXPECT_GT(gallery.forget_sightings_before(1000), 0);
  EXPECT_FALSE(gallery.store_assignments({}, 9, grouped));
}

TEST_F(GroupingTest, DamagedQualityNamesTheGallery) {
  Gallery gallery(path("p.db"));
  see(gallery, 1, 0, 2);
  {
    const DatabaseKind any{"", 0x54504731, {"", "", "", ""}};
    Database damaged(path("p.db"), any, DatabaseAccess::kWrite);
    damaged.run("UPDATE seen_face SET quality = 9e999 WHERE sighting = 2");
  }
  EXPECT_THAT(message_of([&] { (void)group(gallery); }),
              testing::HasSubstr("p.db: face 2: its quality is damaged"));
}

TEST_F(GroupingTest, KeepsGroupIdsAfterRemovals) {
  Gallery gallery(path("p.db"));
  see(gallery, 3, 0, 3);
  (void)group(gallery);
  ASSERT_THAT(gallery.groups(), SizeIs(3));
  // Forgets the three oldest sightings, and all of the second person.
  EXPECT_EQ(gallery.forget_sightings_before(1000), 3);
  const auto report = gallery.forget_group(2, {});
  ASSERT_TRUE(report);
  EXPECT_EQ(report->sightings, 2);
  EXPECT_TRUE(report->proven()) << report->unproven_records;
  EXPECT_FALSE(gallery.forget_group(2, {}));
  see(gallery, 3, 3, 1);
  (void)group(gallery);
  std::map<std::int64_t, std::int64_t> sizes;
  for (const SightingGroup& of : gallery.groups()) sizes[of.id] = of.sightings;
  // A forgotten person gets a new group with a new number.
  EXPECT_EQ(sizes, (std::map<std::int64_t, std::int64_t>{{1, 3}, {3, 3}, {4, 1}}));
}

TEST_F(GroupingTest, RespectsCorrectionsMadeMeanwhile) {
  Gallery gallery(path("p.db"));
  see(gallery, 2, 0, 3);
  (void)group(gallery);
  const std::int64_t generation = gallery.group_generation();
  // A user assigns the third sighting of the first person to another person.
  (void)gallery.split_group(1, std::vector<std::int64_t>{5}, {1, "me"});
  EXPECT_FALSE(gallery.store_assignments({}, 9, generation));
  see(gallery, 2, 3, 1);
  (void)group(gallery);
  // The two groups of that person stay apart.
  EXPECT_THAT(gallery.groups(), SizeIs(3));
  (void)gallery.undo(0, {2, "me"});
  EXPECT_THAT(gallery.groups(), SizeIs(2));
}

TEST_F(GroupingTest, StepsGiveTheSameGroups) {
  Gallery whole(path("whole.db"));
  see(whole, 6, 0, 3);
  group(whole);
  Gallery pieces(path("pieces.db"));
  see(pieces, 6, 0, 3);
  SightingGrouping grouping(pieces, background_of_the_seen(), {});
  EXPECT_EQ(grouping.pending(), 18);
  EXPECT_TRUE(grouping.step({}, 5));
  EXPECT_EQ(grouping.pending(), 13);
  EXPECT_EQ(pieces.ungrouped_count(), 13);  // placed sightings stay placed
  // A correction by a user meanwhile: grouping starts again from the current state.
  StoredFace ann;
  ann.crop = cv::Mat(160, 128, CV_8UC1, cv::Scalar(90));
  ann.measures = "{}";
  pieces.enroll("Ann", "", ann);
  while (grouping.step({}, 5)) {
  }
  EXPECT_FALSE(grouping.step({}, 5));
  EXPECT_EQ(group_of_sightings(pieces), group_of_sightings(whole));
  EXPECT_EQ(grouping.report().assigned, 18);
  EXPECT_EQ(grouping.report().groups, 6);
  GroupingOptions wrong;
  wrong.false_merges = 2;
  EXPECT_THROW(SightingGrouping(pieces, background_of_the_seen(), wrong), std::invalid_argument);
}

TEST_F(GroupingTest, GroupFinderFindsTheGroupOfANewFace) {
  Gallery gallery(path("one.db"));
  GroupFinder finder(gallery, background_of_the_seen());
  const auto set = recognition::synthetic_faces(6, 5, 0.2, 5, 0, {128, 160});
  EXPECT_EQ(finder.find(set.faces[4], 0.9, {}), 0);  // there are none
  see(gallery, 5, 0, 4);
  group(gallery);
  EXPECT_EQ(finder.find(set.faces[4], 0.9, {}), 0);  // the new sightings are not read yet
  finder.invalidate();
  for (std::int64_t p = 0; p < 5; ++p)
    EXPECT_EQ(finder.find(set.faces[static_cast<std::size_t>(5 * p + 4)], 0.9, {}), p + 1);
  EXPECT_EQ(finder.find(set.faces[29], 0.9, {}), 0);  // the sixth was never seen
  EXPECT_EQ(gallery.groups().size(), 5U);
}

}  // namespace
}  // namespace tarsier::face::people
