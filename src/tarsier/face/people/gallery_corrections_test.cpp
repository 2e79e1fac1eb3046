// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/people/testing_gallery.h"
#include "tarsier/face/recognition/testing_faces.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <sys/wait.h>
#include <unistd.h>

namespace tarsier::face::people {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const CorrectionStamp kNow{1234, "tester"};

class CorrectionsTest : public FolderTest {
 protected:
  cv::Mat image(int person, int seed) {
    return recognition::synthetic_faces(1, 1, 0.2, static_cast<std::uint64_t>(seed), person,
                                        {128, 160})
        .faces[0];
  }
  std::int64_t enroll(Gallery& gallery, const std::string& name, int person, int seed) {
    StoredFace face;
    face.crop = image(person, seed);
    face.measures = "{}";
    face.source = "x.png";
    face.time = seed;
    return gallery.enroll(name, "agreed", face);
  }
  std::int64_t see(Gallery& gallery, const std::string& name, bool known, int person, int seed) {
    const SightingFace face{image(person, seed), 0.5, "{}"};
    return gallery.add_sighting(seed, "camera", name, known, 0.9, &face);
  }
  // Groups of sightings of unknown people, as grouping makes them.
  void place(Gallery& gallery, std::int64_t sighting, std::int64_t group) {
    const std::vector<Gallery::SightingAssignment> assignments{{sighting, group, {}}};
    ASSERT_TRUE(gallery.store_assignments(assignments, gallery.next_group() + 1,
                                          gallery.group_generation()));
  }
  static std::vector<std::string> who(Gallery& gallery) {
    std::vector<std::string> out;
    for (const Person& person : gallery.people())
      out.push_back(person.name + ":" + std::to_string(person.faces));
    return out;
  }
  NoProgress progress_;
};

TEST_F(CorrectionsTest, MovesMergesSplitsAndUndoes) {
  Gallery gallery(path("p.db"));
  const std::int64_t a1 = enroll(gallery, "Ann", 1, 1);
  const std::int64_t a2 = enroll(gallery, "Ann", 1, 2);
  (void)enroll(gallery, "Ben", 2, 3);
  (void)see(gallery, "Ann", true, 1, 9);
  std::int64_t generation = gallery.generation();
  const std::int64_t moved = gallery.move_faces(std::vector<std::int64_t>{a2}, "Ben", kNow);
  EXPECT_GT(gallery.generation(), generation);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:1", "Ben:2"));
  const std::int64_t merged = gallery.merge_people("Ann", "Ben", kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ben:3"));
  EXPECT_EQ(gallery.sightings()[0].name, "Ben");
  // The earlier correction cannot be undone before the later one.
  EXPECT_THAT(message_of([&] { (void)gallery.undo(moved, kNow); }), HasSubstr("undo it first"));
  EXPECT_THAT(who(gallery), ElementsAre("Ben:3"));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:1", "Ben:2"));
  EXPECT_EQ(gallery.find("Ann")->note, "agreed");
  EXPECT_EQ(gallery.sightings()[0].name, "Ann");
  EXPECT_THAT(message_of([&] { (void)gallery.undo(merged, kNow); }), HasSubstr("undone already"));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:2", "Ben:1"));
  EXPECT_THAT(message_of([&] { (void)gallery.undo(0, kNow); }), HasSubstr("nothing to undo"));

  const std::int64_t split = gallery.split_person("Ann", std::vector{a1, a1}, "Zoe", kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:1", "Ben:1", "Zoe:1"));
  const auto entry = gallery.correction(split);
  ASSERT_TRUE(entry);
  EXPECT_EQ(entry->kind, "split");
  EXPECT_EQ(entry->from, "Ann");
  EXPECT_EQ(entry->to, "Zoe");
  EXPECT_EQ(entry->count, 1);
  EXPECT_EQ(entry->actor, "tester");
  (void)gallery.undo(split, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:2", "Ben:1"));
  EXPECT_EQ(gallery.correction(split)->undone, gallery.corrections(1)[0].id);
}

TEST_F(CorrectionsTest, RejectsInvalidCorrections) {
  Gallery gallery(path("p.db"));
  const std::int64_t face = enroll(gallery, "Ann", 1, 1);
  const std::int64_t other = enroll(gallery, "Ben", 2, 1);
  const std::int64_t bare = gallery.add_sighting(5, "camera", "Ann", true, 0.9);
  const std::int64_t nobody = see(gallery, "", false, 3, 1);
  const std::vector<std::int64_t> one{face};
  const std::int64_t generation = gallery.generation();
  EXPECT_THAT(message_of([&] { (void)gallery.not_this_face(99, kNow); }), HasSubstr("no face 99"));
  EXPECT_THAT(message_of([&] { (void)gallery.not_this_sighting(99, kNow); }),
              HasSubstr("no sighting 99"));
  EXPECT_THAT(message_of([&] { (void)gallery.not_this_sighting(bare, kNow); }),
              HasSubstr("was stored"));
  EXPECT_THAT(message_of([&] { (void)gallery.not_this_sighting(nobody, kNow); }),
              HasSubstr("has no name"));
  EXPECT_THAT(message_of([&] { (void)gallery.move_faces(one, "Ann", kNow); }),
              HasSubstr("already"));
  EXPECT_THAT(message_of([&] { (void)gallery.move_faces({}, "Ben", kNow); }), HasSubstr("no face"));
  EXPECT_THAT(message_of([&] {
                (void)gallery.move_faces(std::vector{face, other}, "Zoe", kNow);
              }),
              HasSubstr("two people"));
  EXPECT_THAT(message_of([&] { (void)gallery.move_faces(one, "a\nb", kNow); }),
              HasSubstr("control character"));
  EXPECT_THAT(message_of([&] { (void)gallery.split_person("Ann", one, "Zoe", kNow); }),
              HasSubstr("at least must stay"));
  EXPECT_THAT(
      message_of([&] { (void)gallery.split_person("Ann", std::vector{other}, "Zoe", kNow); }),
      HasSubstr("not one of 'Ann'"));
  EXPECT_THAT(message_of([&] { (void)gallery.split_person("Ann", one, "Ben", kNow); }),
              HasSubstr("enrolled already"));
  EXPECT_THAT(message_of([&] { (void)gallery.merge_people("Ann", "Nobody", kNow); }),
              HasSubstr("nobody is enrolled as 'Nobody'"));
  EXPECT_THAT(message_of([&] { (void)gallery.merge_people("Ann", "Ann", kNow); }),
              HasSubstr("one person"));
  EXPECT_THAT(message_of([&] { (void)gallery.merge_groups(1, 2, kNow); }), HasSubstr("no group 1"));
  EXPECT_THAT(message_of([&] { (void)gallery.name_group(1, "Zoe", "", 20, kNow); }),
              HasSubstr("no group 1"));
  EXPECT_THAT(message_of([&] { (void)gallery.undo(7, kNow); }), HasSubstr("no correction 7"));
  try {
    (void)gallery.undo(7, kNow);
  } catch (const MissingEntryError& error) {
    EXPECT_EQ(error.entry(), "correction");
  }
  EXPECT_EQ(gallery.generation(), generation);
  EXPECT_THAT(gallery.corrections(), IsEmpty());
  EXPECT_THAT(who(gallery), ElementsAre("Ann:1", "Ben:1"));
}

// A face that was ruled out for a person is not identified as that person again. This holds after
// learning and for a model in use. After undo the old state returns.
TEST_F(CorrectionsTest, NegativeTakesEffectAtOnce) {
  Gallery gallery(path("p.db"));
  for (int seed = 1; seed < 4; ++seed) {
    (void)enroll(gallery, "Ann", 1, seed);
    (void)enroll(gallery, "Ben", 2, seed);
  }
  auto model = load_gallery_model(gallery, nullptr, true, TrainingPolicy::kIfNeeded, progress_, {});
  ASSERT_TRUE(model);
  GalleryFollower follower(gallery, nullptr, std::move(model));
  const cv::Mat wrong = image(1, 50);
  const auto named = [&](const cv::Mat& face) {
    (void)follower.update();
    return recognize(*follower.recognizer(), recognition::template_of(*follower.recognizer(), face),
                     0.1)
        .label;
  };
  EXPECT_EQ(named(wrong), "Ann");
  const std::int64_t sighting = see(gallery, "Ann", true, 1, 50);
  Gallery by_another_program(path("p.db"));
  (void)by_another_program.not_this_sighting(sighting, kNow);
  EXPECT_EQ(named(wrong), "Ben");
  EXPECT_EQ(named(image(1, 2)), "Ann");
  EXPECT_FALSE(gallery.sightings()[0].known);
  EXPECT_EQ(gallery.sightings()[0].name, "");
  EXPECT_THAT(gallery.ungrouped(), ElementsAre(sighting));
  // It still holds after learning again.
  const auto again =
      load_gallery_model(gallery, nullptr, true, TrainingPolicy::kAlways, progress_, {});
  ASSERT_TRUE(again);
  EXPECT_EQ(again->recognizer.negatives.rows(), 1);
  EXPECT_EQ(named(wrong), "Ben");
  (void)by_another_program.undo(0, kNow);
  EXPECT_EQ(named(wrong), "Ann");
  EXPECT_TRUE(gallery.sightings()[0].known);
  EXPECT_THAT(gallery.negatives(), IsEmpty());
}

TEST_F(CorrectionsTest, RejectedFaceBecomesANegative) {
  Gallery gallery(path("p.db"));
  for (int seed = 1; seed < 4; ++seed) (void)enroll(gallery, "Ann", 1, seed);
  const std::int64_t wrong = enroll(gallery, "Ann", 2, 1);
  auto model = load_gallery_model(gallery, nullptr, true, TrainingPolicy::kIfNeeded, progress_, {});
  GalleryFollower follower(gallery, nullptr, std::move(model));
  (void)gallery.not_this_face(wrong, kNow);
  EXPECT_EQ(follower.update(), GalleryFollower::Change::kFaces);
  const auto label = [&](int person, int seed) {
    return recognize(*follower.recognizer(),
                     recognition::template_of(*follower.recognizer(), image(person, seed)), 0.1)
        .label;
  };
  EXPECT_EQ(label(2, 1), "");
  EXPECT_EQ(label(1, 2), "Ann");
  EXPECT_THAT(who(gallery), ElementsAre("Ann:3"));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:4"));
  EXPECT_EQ(gallery.face(wrong)->source, "x.png");
  // A moved face belongs to the other person at once, without learning.
  (void)follower.update();
  (void)gallery.move_faces(std::vector{wrong}, "Ben", kNow);
  auto learned =
      load_gallery_model(gallery, nullptr, true, TrainingPolicy::kIfNeeded, progress_, {});
  follower.replace(std::move(learned));
  EXPECT_EQ(label(2, 1), "Ben");
  (void)gallery.move_faces(std::vector{wrong}, "Cid", kNow);
  (void)follower.update();
  EXPECT_EQ(label(2, 1), "Cid");
}

TEST_F(CorrectionsTest, NamesAGroupAndUndoesIt) {
  Gallery gallery(path("p.db"));
  for (int seed = 1; seed < 4; ++seed) place(gallery, see(gallery, "", false, 1, seed), 1);
  place(gallery, see(gallery, "", false, 2, 1), 2);
  const std::int64_t id = gallery.name_group(1, "Ann <b>&\"'", "asked", 2, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann <b>&\"':2"));
  EXPECT_THAT(gallery.groups(), SizeIs(1));
  EXPECT_EQ(gallery.sightings()[1].name, "Ann <b>&\"'");
  EXPECT_TRUE(gallery.sightings()[1].known);
  EXPECT_EQ(gallery.next_group(), 5);
  EXPECT_EQ(gallery.correction(id)->from, "group 1");
  (void)gallery.undo(id, kNow);
  EXPECT_THAT(gallery.people(), IsEmpty());
  ASSERT_THAT(gallery.groups(), SizeIs(2));
  EXPECT_EQ(gallery.groups()[0].sightings, 3);
  EXPECT_FALSE(gallery.sightings()[1].known);
  // A person who was enrolled meanwhile with other faces is kept.
  (void)gallery.name_group(1, "Ann", "", 20, kNow);
  (void)enroll(gallery, "Ann", 1, 77);
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:1"));
}

TEST_F(CorrectionsTest, MergesAndSplitsGroups) {
  Gallery gallery(path("p.db"));
  std::vector<std::int64_t> seen;
  for (int seed = 1; seed < 5; ++seed) seen.push_back(see(gallery, "", false, 1, seed));
  place(gallery, seen[0], 1);
  place(gallery, seen[1], 1);
  place(gallery, seen[2], 2);
  place(gallery, seen[3], 3);
  (void)gallery.split_group(1, std::vector{seen[1]}, kNow);
  const std::int64_t made = gallery.groups().back().id;
  EXPECT_THAT(gallery.cannot_link_pairs(), ElementsAre(std::pair(std::int64_t{1}, made)));
  // After a merge, groups that were apart from the first group are apart from the second.
  (void)gallery.merge_groups(1, 2, kNow);
  EXPECT_THAT(gallery.cannot_link_pairs(), ElementsAre(std::pair(std::int64_t{2}, made)));
  EXPECT_THAT(message_of([&] { (void)gallery.split_group(2, std::vector{seen[1]}, kNow); }),
              HasSubstr("not one of group 2"));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(gallery.cannot_link_pairs(), ElementsAre(std::pair(std::int64_t{1}, made)));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(gallery.cannot_link_pairs(), IsEmpty());
  EXPECT_THAT(gallery.groups(), SizeIs(3));
  EXPECT_EQ(gallery.group(1)->sightings, 2);
}

// Forgetting a person removes everything: ruled-out faces, sightings, and log entries.
TEST_F(CorrectionsTest, ForgettingRemovesLogEntries) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Ann", 1, 1);
  (void)enroll(gallery, "Ben", 2, 1);
  const std::int64_t wrong = enroll(gallery, "Ann", 3, 1);
  (void)see(gallery, "Ann", true, 1, 8);
  (void)gallery.not_this_face(wrong, kNow);
  (void)gallery.move_faces(std::vector<std::int64_t>{1}, "Cid", kNow);
  (void)gallery.undo(0, kNow);
  const auto report = gallery.forget("Ann", {});
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->proven());
  EXPECT_EQ(report->sightings, 1);
  EXPECT_THAT(gallery.corrections(), IsEmpty());
  EXPECT_THAT(gallery.negatives(), IsEmpty());
  EXPECT_THAT(who(gallery), ElementsAre("Ben:1"));
  place(gallery, see(gallery, "", false, 5, 1), 1);
  ASSERT_TRUE(gallery.forget_all({}));
  EXPECT_THAT(gallery.groups(), IsEmpty());
  EXPECT_EQ(gallery.sighting_count(), 0);
}

// People who were merged into a forgotten person are forgotten, too, also indirectly.
TEST_F(CorrectionsTest, ForgettingFollowsMerges) {
  Gallery gallery(path("p.db"));
  const std::int64_t wrong = enroll(gallery, "A. Miller", 1, 5);
  (void)enroll(gallery, "A. Miller", 1, 6);
  (void)enroll(gallery, "Ann", 1, 1);
  (void)enroll(gallery, "Ben", 2, 1);
  (void)enroll(gallery, "Cid", 3, 1);
  (void)gallery.not_this_face(wrong, kNow);
  (void)gallery.merge_people("A. Miller", "Ann", kNow);
  (void)gallery.merge_people("Ann", "Ben", kNow);
  const std::int64_t other = gallery.move_faces(std::vector{gallery.last_face()}, "Eve", kNow);
  ASSERT_TRUE(gallery.forget("Ben", {}));
  ASSERT_THAT(gallery.corrections(), SizeIs(1));
  EXPECT_EQ(gallery.corrections()[0].id, other);
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(message_of([&] { (void)gallery.undo(0, kNow); }), HasSubstr("nothing to undo"));
  EXPECT_THAT(who(gallery), ElementsAre("Cid:1"));
}

// A merge that was undone makes nobody else forgotten.
TEST_F(CorrectionsTest, ForgettingKeepsTheLogOfOthers) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Ann", 1, 1);
  (void)enroll(gallery, "Ben", 2, 1);
  const std::int64_t face = enroll(gallery, "Ben", 2, 2);
  (void)gallery.merge_people("Ben", "Ann", kNow);
  (void)gallery.undo(0, kNow);
  const std::int64_t moved = gallery.move_faces(std::vector{face}, "Cid", kNow);
  ASSERT_TRUE(gallery.forget("Ann", {}));
  ASSERT_THAT(gallery.corrections(), SizeIs(1));
  EXPECT_EQ(gallery.corrections()[0].id, moved);
}

// The log names a person who is not enrolled any more.
TEST_F(CorrectionsTest, ForgetsNamesInTheLog) {
  Gallery gallery(path("p.db"));
  place(gallery, see(gallery, "", false, 1, 1), 1);
  (void)gallery.name_group(1, "Zoe Real", "", 20, kNow);
  (void)gallery.undo(0, kNow);
  ASSERT_THAT(gallery.people(), IsEmpty());
  EXPECT_FALSE(gallery.forget("Zoe Real", {}));
  EXPECT_FALSE(gallery.is_in_log("Zoe"));
  EXPECT_EQ(gallery.forget_in_log("group 1"), 0);
  EXPECT_TRUE(gallery.is_in_log("Zoe Real"));
  EXPECT_THAT(gallery.corrections(), SizeIs(2));
  EXPECT_EQ(gallery.forget_in_log("Zoe Real"), 1);
  EXPECT_THAT(gallery.corrections(), IsEmpty());
  // Somebody else may have got the name since: forgetting them deletes all entries with the name.
  (void)gallery.name_group(1, "Zoe", "", 20, kNow);
  (void)gallery.undo(0, kNow);
  (void)enroll(gallery, "Zoe", 1, 3);
  ASSERT_TRUE(gallery.forget("Zoe", {}));
  EXPECT_THAT(gallery.corrections(), IsEmpty());
}

// Sightings of strangers name the nearest person. They stay when that person is forgotten.
TEST_F(CorrectionsTest, ForgettingKeepsSightingsOfStrangers) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Ann", 1, 1);
  (void)see(gallery, "Ann", true, 1, 8);
  const std::int64_t stranger = see(gallery, "Ann", false, 5, 1);
  place(gallery, stranger, 1);
  const auto report = gallery.forget("Ann", {});
  ASSERT_TRUE(report);
  EXPECT_EQ(report->sightings, 1);
  EXPECT_TRUE(report->proven());
  ASSERT_THAT(gallery.sightings(), SizeIs(1));
  EXPECT_EQ(gallery.sightings()[0].id, stranger);
  EXPECT_EQ(gallery.sightings()[0].name, "");
  EXPECT_TRUE(gallery.sightings()[0].has_face);
  EXPECT_EQ(gallery.group(1)->sightings, 1);
}

// Undoing "name" removes the person whom it added. A later correction of that person comes first.
TEST_F(CorrectionsTest, UndoesCorrectionsOfAnAddedPersonInOrder) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Ben", 2, 1);
  place(gallery, see(gallery, "", false, 1, 1), 1);
  const std::int64_t named = gallery.name_group(1, "Zoe", "", 20, kNow);
  const std::int64_t face = enroll(gallery, "Zoe", 1, 7);
  const std::int64_t moved = gallery.move_faces(std::vector{face}, "Ben", kNow);
  EXPECT_THAT(message_of([&] { (void)gallery.undo(named, kNow); }), HasSubstr("undo it first"));
  (void)gallery.undo(moved, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ben:1", "Zoe:2"));
  (void)gallery.undo(named, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ben:1", "Zoe:1"));
}

// Groups that a user split stay apart, also after one of them was named and that was undone.
TEST_F(CorrectionsTest, UndoingANameKeepsGroupsApart) {
  Gallery gallery(path("p.db"));
  const std::int64_t first = see(gallery, "", false, 1, 1);
  const std::int64_t second = see(gallery, "", false, 1, 2);
  place(gallery, first, 1);
  place(gallery, second, 1);
  (void)gallery.split_group(1, std::vector{second}, kNow);
  const auto apart = gallery.cannot_link_pairs();
  ASSERT_THAT(apart, SizeIs(1));
  const std::int64_t id = gallery.name_group(1, "Zoe", "", 20, kNow);
  EXPECT_THAT(gallery.cannot_link_pairs(), IsEmpty());
  EXPECT_EQ(gallery.correction(id)->count, 2);  // a face and a sighting
  (void)gallery.undo(0, kNow);
  EXPECT_EQ(gallery.cannot_link_pairs(), apart);
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(gallery.cannot_link_pairs(), IsEmpty());
}

// A face that becomes one of the person's does not rule the person out any more.
TEST_F(CorrectionsTest, NamingOverrulesANegative) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Ann", 1, 1);
  const std::int64_t seen = see(gallery, "Ann", true, 1, 2);
  (void)gallery.not_this_sighting(seen, kNow);
  (void)gallery.not_this_person("Ann", {image(2, 1), 0.5, "{}"}, "camera", kNow);
  ASSERT_THAT(gallery.negatives(), SizeIs(2));
  place(gallery, seen, 1);
  (void)gallery.name_group(1, "Ann", "", 20, kNow);
  ASSERT_THAT(gallery.negatives(), SizeIs(1));  // of somebody else
  ASSERT_THAT(gallery.overruled_negatives(), SizeIs(1));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(gallery.negatives(), SizeIs(2));
  // A face that becomes no enrolled face counts, too, because its sighting is named.
  const SightingFace better{image(1, 3), 0.9, "{}"};
  place(gallery, gallery.add_sighting(3, "camera", "", false, 0, &better), 1);
  (void)gallery.name_group(1, "Ann", "", 1, kNow);
  EXPECT_THAT(gallery.negatives(), SizeIs(1));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(gallery.negatives(), SizeIs(2));
}

TEST_F(CorrectionsTest, MovingAndMergingOverruleNegatives) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Person 2", 1, 5);
  const std::int64_t wrong = enroll(gallery, "Person 2", 1, 8);
  (void)enroll(gallery, "Ann", 1, 1);
  const std::int64_t face = enroll(gallery, "Ann", 1, 8);
  (void)gallery.not_this_face(wrong, kNow);
  ASSERT_THAT(gallery.negatives(), SizeIs(1));
  (void)gallery.merge_people("Person 2", "Ann", kNow);
  EXPECT_THAT(gallery.negatives(), IsEmpty());
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(gallery.negatives(), SizeIs(1));
  (void)gallery.move_faces(std::vector{face}, "Person 2", kNow);
  EXPECT_THAT(gallery.negatives(), IsEmpty());
  // "Not this person" of the same face again: the last correction holds.
  (void)gallery.not_this_face(face, kNow);
  EXPECT_THAT(gallery.negatives(), SizeIs(1));
  (void)gallery.merge_people("Ann", "Person 2", kNow);
  EXPECT_THAT(gallery.negatives(), SizeIs(1));
  // Enrolling is no correction: nothing brings the negative back.
  (void)enroll(gallery, "Person 2", 1, 8);
  EXPECT_THAT(gallery.negatives(), IsEmpty());
}

// A negative is a face of somebody who may not have agreed. It ends with its sighting.
TEST_F(CorrectionsTest, NegativesEndWithTheirSighting) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Ann", 1, 1);
  const std::int64_t old = see(gallery, "Ann", true, 5, 10);
  (void)gallery.not_this_sighting(old, kNow);
  const std::int64_t grouped = see(gallery, "Ann", true, 5, 2000);
  (void)gallery.not_this_sighting(grouped, kNow);
  place(gallery, grouped, 1);
  (void)gallery.not_this_person("Ann", {image(6, 1), 0.5, "{}"}, "camera", kNow);
  ASSERT_THAT(gallery.negatives(), SizeIs(3));
  const std::int64_t generation = gallery.generation();
  EXPECT_EQ(gallery.forget_sightings_before(1000), 1);
  EXPECT_THAT(gallery.negatives(), SizeIs(2));
  EXPECT_NE(gallery.generation(), generation);
  const auto report = gallery.forget_group(1, {});
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->proven()) << report->unproven_records;
  EXPECT_THAT(gallery.negatives(), SizeIs(1));
  // The same for an enrolled face that a sighting gave.
  const std::int64_t third = see(gallery, "", false, 5, 30);
  place(gallery, third, 2);
  (void)gallery.name_group(2, "Zoe", "", 20, kNow);
  (void)gallery.not_this_face(gallery.last_face(), kNow);
  ASSERT_THAT(gallery.negatives(), SizeIs(2));
  EXPECT_EQ(gallery.forget_sightings_before(1000), 1);
  EXPECT_THAT(gallery.negatives(), SizeIs(1));
  // Undoing finds nothing to restore.
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:1", "Zoe:0"));
}

// A sighting that is of Ben, and was once rejected as Ann, is forgotten with Ben.
TEST_F(CorrectionsTest, ForgettingRemovesNegativesOfOthers) {
  Gallery gallery(path("p.db"));
  (void)enroll(gallery, "Ann", 1, 1);
  const std::int64_t seen = see(gallery, "Ann", true, 2, 2);
  (void)gallery.not_this_sighting(seen, kNow);
  place(gallery, seen, 1);
  (void)gallery.name_group(1, "Ben", "", 20, kNow);
  ASSERT_THAT(gallery.negatives(), SizeIs(1));
  const auto report = gallery.forget("Ben", {});
  ASSERT_TRUE(report);
  EXPECT_TRUE(report->proven()) << report->unproven_records;
  EXPECT_THAT(gallery.negatives(), IsEmpty());
  // The same for a face that was enrolled under the wrong name first.
  (void)gallery.not_this_face(enroll(gallery, "Ann", 2, 4), kNow);
  (void)enroll(gallery, "Ben", 2, 4);
  EXPECT_TRUE(gallery.forget("Ben", {})->proven());
  EXPECT_THAT(gallery.negatives(), IsEmpty());
}

// A correction that was reported as done survives a kill.
TEST_F(CorrectionsTest, SurvivesAKill) {
  std::int64_t face = 0;
  {
    Gallery gallery(path("p.db"));
    face = enroll(gallery, "Ann", 1, 1);
    (void)enroll(gallery, "Ann", 1, 2);
  }
  const pid_t child = fork();
  if (child == 0) {
    Gallery gallery(path("p.db"));
    (void)gallery.split_person("Ann", std::vector{face}, "Zoe", kNow);
    (void)::kill(::getpid(), SIGKILL);
    ::_exit(1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  Gallery gallery(path("p.db"));
  EXPECT_THAT(who(gallery), ElementsAre("Ann:1", "Zoe:1"));
  (void)gallery.undo(0, kNow);
  EXPECT_THAT(who(gallery), ElementsAre("Ann:2"));
}

}  // namespace
}  // namespace tarsier::face::people
