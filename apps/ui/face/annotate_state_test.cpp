// SPDX-License-Identifier: MIT
#include "ui/face/annotate_state.h"

#include "tarsier/core/errors.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <unistd.h>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

AnnotateState three_images() {
  AnnotateState state;
  for (const char* path : {"/p/a.png", "/p/b.png", "/p/c.png"}) state.add_image(path);
  return state;
}

AnnotateState four_points() {
  AnnotateState state = three_images();
  for (int i = 0; i < 4; ++i) state.add_point(0, {10.25 * i, 5.5});
  return state;
}

Eigen::Matrix2Xd square(double at) {
  Eigen::Matrix2Xd points(2, 4);
  points << at, at + 10, at + 10, at, at, at, at + 10, at + 10;
  return points;
}

std::string text_of(const AnnotateState& state) {
  // Everything there is, as a record against nothing.
  return state.difference(AnnotateState(), "").dump();
}

TEST(AnnotateState, AddsPointsWithoutPositionsToTheOtherImages) {
  AnnotateState state = four_points();
  EXPECT_EQ(state.points(), 4);
  EXPECT_TRUE(state.image(0).done);
  EXPECT_TRUE(state.image(0).is_shown(3));
  EXPECT_EQ(state.image(0).points(0, 3), 30.75);
  EXPECT_FALSE(state.image(1).has_points());
  EXPECT_EQ(state.finished().samples.size(), 1u);
  EXPECT_EQ(state.add_image("/p/b.png"), 1) << "an image is there once";
}

TEST(AnnotateState, RemovingAPointRenumbersLinesAndSymmetry) {
  AnnotateState state = four_points();
  state.set_points(1, square(20));
  state.set_done(1, true);
  state.toggle_connection(0, 1);
  state.toggle_connection(3, 2);
  state.toggle_mirror(0, 3);
  state.toggle_mirror(2, 2);
  state.remove_point(1);
  EXPECT_EQ(state.points(), 3);
  EXPECT_EQ(state.image(1).points.col(1), square(20).col(2));
  ASSERT_EQ(state.connections().size(), 1u);
  EXPECT_EQ(state.connections()[0], (std::array<int, 2>{1, 2}));
  EXPECT_EQ(state.mirror(), (std::vector<int>{2, 1, 0}));
  EXPECT_EQ(state.finished().mirror, (std::vector<int>{2, 1, 0}));
}

TEST(AnnotateState, ToggleMirrorKeepsAnInvolution) {
  AnnotateState state = four_points();
  state.toggle_mirror(0, 1);
  state.toggle_mirror(1, 2);  // 1 leaves 0
  EXPECT_EQ(state.mirror(), (std::vector<int>{-1, 2, 1, -1}));
  EXPECT_TRUE(state.finished().mirror.empty()) << "half a symmetry is none";
  state.toggle_mirror(2, 1);
  EXPECT_EQ(state.mirror(), (std::vector<int>{-1, -1, -1, -1}));
  state.toggle_mirror(3, 3);
  EXPECT_EQ(state.mirror()[3], 3);
  state.toggle_mirror(3, 3);
  EXPECT_EQ(state.mirror()[3], -1);
}

TEST(AnnotateState, ToggleConnectionIgnoresTheDirection) {
  AnnotateState state = four_points();
  state.toggle_connection(2, 1);
  EXPECT_EQ(state.connections().size(), 1u);
  state.toggle_connection(1, 2);
  EXPECT_TRUE(state.connections().empty());
  EXPECT_THROW(state.toggle_connection(1, 1), std::invalid_argument);
}

TEST(AnnotateState, HiddenPointsAreMissingInTheSetAndKeepTheirPosition) {
  AnnotateState state = four_points();
  state.set_points(1, square(3));
  state.hide_point(1, 2, true);
  EXPECT_EQ(state.finished().samples.size(), 1u) << "a proposal is not finished";
  state.set_done(1, true);
  EXPECT_TRUE(state.finished().samples.at(1).is_missing(2));
  EXPECT_EQ(state.image(1).points.col(2), square(3).col(2));
  state.hide_point(1, 2, false);
  EXPECT_TRUE(state.finished().samples.at(1).is_complete());
}

TEST(AnnotateState, CopiesAreIndependent) {
  AnnotateState state = four_points();
  const AnnotateState before = state;
  state.move_point(0, 1, {99, 98});
  EXPECT_EQ(before.image(0).points(0, 1), 10.25);
  EXPECT_EQ(&before.image(1), &state.image(1)) << "what is the same is shared";
}

// Every kind of edit, as the journal records it, and again: the same state.
TEST(AnnotateState, RecordsRestoreEveryEditAndAreIdempotent) {
  AnnotateState state = three_images();
  AnnotateState replayed = three_images();
  std::vector<nlohmann::json> records;
  const auto edit = [&](const std::string& why, auto change) {
    const AnnotateState before = state;
    change(state);
    const nlohmann::json record = nlohmann::json::parse(state.difference(before, why).dump());
    replayed.apply(record, "journal");
    EXPECT_EQ(text_of(replayed), text_of(state)) << why;
    replayed.apply(record, "journal");
    EXPECT_EQ(text_of(replayed), text_of(state)) << why << ", twice";
    records.push_back(record);
  };
  for (int i = 0; i < 5; ++i)
    edit("add", [&](AnnotateState& s) { s.add_point(0, {1.0 / 3 * i, 7.1 * i}); });
  edit("delete", [](AnnotateState& s) { s.remove_point(2); });
  edit("connect", [](AnnotateState& s) { s.toggle_connection(0, 3); });
  edit("mirror", [](AnnotateState& s) { s.toggle_mirror(1, 2); });
  edit("stage", [](AnnotateState& s) { s.set_stage(AnnotateStage::kImages); });
  edit("proposal", [](AnnotateState& s) { s.set_points(2, square(40)); });
  edit("move", [](AnnotateState& s) { s.move_point(2, 1, {0.1, 0.7}); });
  edit("hide", [](AnnotateState& s) { s.hide_point(2, 0, true); });
  edit("agree", [](AnnotateState& s) { s.set_done(2, true); });
  edit("delete", [](AnnotateState& s) { s.remove_point(3); });
  edit("add late", [](AnnotateState& s) { s.add_point(0, {8, 9}); });
  edit("image", [](AnnotateState& s) { s.add_image("/p/d.png"); });
  edit("clear", [](AnnotateState& s) { s.clear_points(2); });
  // All of the old journal over a set that was written in between.
  for (const nlohmann::json& record : records) replayed.apply(record, "journal");
  EXPECT_EQ(text_of(replayed), text_of(state));
}

TEST(AnnotateState, UnfinishedHoldsWhatTheSetCannot) {
  AnnotateState state = four_points();
  state.set_points(1, square(3));
  state.hide_point(1, 2, true);
  state.set_done(1, true);
  state.set_points(2, square(50), true);  // not agreed
  state.toggle_mirror(0, 1);              // half a symmetry
  AnnotateState other = three_images();
  other.load(state.finished(), "/p/set.yaml");
  other.apply(state.unfinished(), "journal");
  EXPECT_EQ(text_of(other), text_of(state));
}

// Killed when the set was written and the journal was still the old one.
TEST(AnnotateState, ReplaysAJournalOlderThanTheSet) {
  AnnotateState state = four_points();
  state.set_points(1, square(3));
  state.set_done(1, true);
  std::vector<nlohmann::json> records{state.unfinished()};
  const auto add = [&](const Eigen::Vector2d& place) {
    const AnnotateState before = state;
    state.add_point(0, place);
    records.push_back(state.difference(before, "add"));
  };
  add({70, 80});
  {
    const AnnotateState before = state;
    state.toggle_connection(0, 4);
    records.push_back(state.difference(before, "connect"));
  }
  add({90, 10});
  AnnotateState other = three_images();
  other.load(state.finished(), "/p/set.yaml");
  other.replay(records, "journal");
  EXPECT_EQ(text_of(other), text_of(state));
  // Of another set: its points are not thrown away.
  AnnotateState foreign = three_images();
  foreign.load(state.finished(), "/p/set.yaml");
  const std::string whole = text_of(foreign);
  EXPECT_THROW(foreign.replay({records[0]}, "journal"), InputError);
  EXPECT_EQ(text_of(foreign), whole);
}

TEST(AnnotateState, ReadsTheFormerKeyPictures) {
  AnnotateState state = four_points();
  state.apply(
      nlohmann::json::parse(
          R"({"points":4,"stage":"pictures","pictures":[{"path":"/p/old.png","done":true,"touched":true,"points":[[1,2],[3,4],[5,6],[7,8]],"hidden":[]}]})"),
      "journal");
  EXPECT_EQ(state.stage(), AnnotateStage::kImages);
  EXPECT_EQ(state.image(state.images() - 1).path, "/p/old.png");
  EXPECT_TRUE(state.image(state.images() - 1).done);
}

TEST(AnnotateState, InvalidRecordsChangeNothing) {
  const AnnotateState state = four_points();
  const std::string before = text_of(state);
  for (
      const char* text : {
          "[]",
          "{}",
          R"({"points":4,"stage":"fly","images":[]})",
          R"({"points":-1,"stage":"points","images":[]})",
          R"({"points":99999999,"stage":"points","images":[]})",
          R"({"points":4,"stage":"points","images":[{"path":"","done":true,"touched":true,"points":[],"hidden":[]}]})",
          R"({"points":4,"stage":"points","images":[{"path":"x","done":true,"touched":true,"points":[[1]],"hidden":[]}]})",
          R"({"points":4,"stage":"points","images":[{"path":"x","done":true,"touched":true,"points":[[1,1e300]],"hidden":[]}]})",
          R"({"points":4,"stage":"points","images":[{"path":"x","done":true,"touched":true,"points":[],"hidden":[4]}]})",
          R"({"points":2,"stage":"points","images":[]})",
          R"({"points":4,"stage":"points","mirror":[1,1,1,1],"images":[]})",
          R"({"points":4,"stage":"points","mirror":[9,1,2,3],"images":[]})",
          R"({"points":4,"stage":"points","connections":[[0,4]],"images":[]})",
      }) {
    AnnotateState changed = state;
    EXPECT_THROW(changed.apply(nlohmann::json::parse(text), "journal"), InputError) << text;
    EXPECT_EQ(text_of(changed), before) << text;
  }
}

class AnnotateJournalTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() /
              ("annotate-journal-" + std::to_string(getpid()) + "-" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    path_ = (folder_ / "set.yaml.journal").string();
  }
  void TearDown() override { fs::remove_all(folder_); }
  void append_text(const std::string& text) const { std::ofstream(path_, std::ios::app) << text; }

  fs::path folder_;
  std::string path_;
};

TEST_F(AnnotateJournalTest, RemovesATruncatedLastLine) {
  {
    AnnotateJournal journal(path_);
    EXPECT_TRUE(journal.open().empty());
    journal.append({{"n", 1}});
    journal.append({{"n", 2}});
  }
  append_text(R"({"n":3,"po)");
  {
    AnnotateJournal journal(path_);
    EXPECT_EQ(journal.open().size(), 2u);
    journal.append({{"n", 4}});
  }
  AnnotateJournal journal(path_);
  const auto records = journal.open();
  ASSERT_EQ(records.size(), 3u);
  EXPECT_EQ(records[2].at("n"), 4);
}

TEST_F(AnnotateJournalTest, ReportsTheNumberOfAnInvalidLine) {
  append_text("{\"n\":1}\nnonsense\n{\"n\":3}\n");
  AnnotateJournal journal(path_);
  try {
    (void)journal.open();
    FAIL() << "took nonsense";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("line 2"), std::string::npos) << error.what();
  }
}

TEST_F(AnnotateJournalTest, RefusesASecondProgramAlsoAfterARestart) {
  AnnotateJournal first(path_);
  (void)first.open();
  AnnotateJournal second(path_);
  EXPECT_THROW((void)second.open(), InputError);
  first.append({{"n", 1}});
  first.restart(nlohmann::json{{"n", 2}});
  EXPECT_THROW((void)second.open(), InputError);
  first.append({{"n", 3}});
  EXPECT_EQ(first.lines(), 2);
}

TEST_F(AnnotateJournalTest, RestartWithoutARecordRemovesTheFile) {
  AnnotateJournal journal(path_);
  (void)journal.open();
  journal.append({{"n", 1}});
  journal.restart(std::nullopt);
  EXPECT_FALSE(fs::exists(path_));
  journal.append({{"n", 2}});
  EXPECT_TRUE(fs::exists(path_));
}

}  // namespace
}  // namespace tarsier
