// SPDX-License-Identifier: MIT
#include "ui/face/people_panel.h"

#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <nlohmann/json.hpp>
#include <optional>

namespace tarsier {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using List = PeoplePanel::List;

// Two groups of unknown faces, of three and of two sightings, and Ann, with two faces.
class PeoplePanelTest : public FolderTest {
 protected:
  void SetUp() override {
    gallery_.emplace(path("p.db"));
    std::vector<face::people::Gallery::SightingAssignment> assignments;
    for (int i = 0; i < 5; ++i) {
      const face::people::SightingFace seen{crop(i), 0.5 + 0.05 * i, "{}"};
      const std::int64_t id = gallery_->add_sighting(1000 + i, "camera", "", false, 0, &seen);
      assignments.push_back({id, i < 3 ? 1 : 2, {}});
    }
    ASSERT_TRUE(gallery_->store_assignments(assignments, 3, gallery_->group_generation()));
    for (int i = 0; i < 2; ++i) gallery_->enroll("Ann", "", stored(10 + i));
    panel_.emplace(*gallery_,
                   PeoplePanel::Options{[] {
                                          return face::people::CorrectionStamp{5000, "tester"};
                                        },
                                        "agreed",
                                        {"Zoe"}});
  }
  static cv::Mat crop(int seed) {
    cv::Mat out(160, 128, CV_8UC1);
    cv::RNG rng(static_cast<std::uint64_t>(seed) + 3);
    rng.fill(out, cv::RNG::UNIFORM, 0, 256);
    cv::GaussianBlur(out, out, {}, 3);
    return out;
  }
  static face::people::StoredFace stored(int seed) {
    face::people::StoredFace out;
    out.crop = crop(seed);
    out.measures = "{}";
    return out;
  }
  void type(const std::string& text) {
    for (const char letter : text) EXPECT_TRUE(panel_->press(key_event(letter)));
  }
  std::vector<std::int64_t> rows() const {
    std::vector<std::int64_t> out;
    const nlohmann::json state = panel_->state();
    for (const auto& row : state["rows"]) out.push_back(row["id"]);
    return out;
  }
  std::vector<std::string> kinds() {
    std::vector<std::string> out;
    for (const auto& entry : gallery_->corrections()) out.push_back(entry.kind);
    return out;
  }
  std::optional<face::people::Gallery> gallery_;
  std::optional<PeoplePanel> panel_;
};

TEST_F(PeoplePanelTest, IgnoresInputWhenClosed) {
  EXPECT_FALSE(panel_->is_open());
  EXPECT_TRUE(panel_->state().is_null());
  for (const char* action :
       {"up", "open", "mark", "name", "merge", "split", "not", "undo", "confirm"})
    EXPECT_FALSE(panel_->act(action)) << action;
  EXPECT_FALSE(panel_->press(key_event(key::kEscape)));
  EXPECT_FALSE(panel_->click({100, 100}));
  cv::Mat image(420, 560, CV_8UC3, cv::Scalar::all(90));
  const cv::Mat before = image.clone();
  panel_->draw(image, {120, 10, 430, 400});
  EXPECT_EQ(cv::norm(image, before, cv::NORM_INF), 0);
}

TEST_F(PeoplePanelTest, NamesAGroupByTyping) {
  EXPECT_TRUE(panel_->act("groups"));
  EXPECT_EQ(panel_->list(), List::kGroups);
  EXPECT_THAT(rows(), ElementsAre(1, 2));
  EXPECT_TRUE(panel_->act("down"));
  EXPECT_TRUE(panel_->act("name"));
  EXPECT_EQ(panel_->state()["typing"], "Zoe");  // who is named next
  // Letters are letters, whatever they do else.
  type("qxb");
  EXPECT_EQ(panel_->state()["typing"], "qxb");
  EXPECT_TRUE(panel_->press(key_event(key::kBackspace)));
  type(" y");
  EXPECT_TRUE(panel_->press(key_event(key::kEnter)));
  ASSERT_TRUE(gallery_->find("qx y"));
  EXPECT_EQ(gallery_->find("qx y")->faces, 2);
  EXPECT_EQ(gallery_->find("qx y")->note, "agreed");
  EXPECT_EQ(gallery_->corrections().at(0).actor, "tester");
  EXPECT_THAT(rows(), ElementsAre(1));
  EXPECT_TRUE(panel_->take_changed());
  EXPECT_FALSE(panel_->take_changed());
  EXPECT_THAT(panel_->take_corrections(), SizeIs(1));
  EXPECT_THAT(panel_->take_message(), HasSubstr("Group 2 is qx y"));
  EXPECT_THAT(panel_->take_message(), IsEmpty());
}

TEST_F(PeoplePanelTest, ProposesNamesAndCanBeCancelled) {
  panel_->name_group(1);
  EXPECT_TRUE(panel_->is_typing());
  EXPECT_EQ(panel_->list(), List::kNone);
  EXPECT_TRUE(panel_->press(key_event(key::kDown)));
  EXPECT_EQ(panel_->state()["typing"], "Ann");
  EXPECT_TRUE(panel_->press(key_event(key::kDown)));
  EXPECT_EQ(panel_->state()["typing"], "Zoe");
  EXPECT_TRUE(panel_->press(key_event(key::kUp)));
  EXPECT_TRUE(panel_->press(key_event(key::kEscape)));
  EXPECT_FALSE(panel_->is_open());
  EXPECT_THAT(kinds(), IsEmpty());
  // By actions alone, as a browser or a script has them.
  panel_->name_group(1);
  EXPECT_TRUE(panel_->act("down"));
  EXPECT_TRUE(panel_->act("confirm"));
  EXPECT_EQ(gallery_->find("Ann")->faces, 5);
  // What is no name is said, and changes nothing.
  panel_->name_group(2);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(panel_->press(key_event(key::kBackspace)));
  EXPECT_TRUE(panel_->act("open"));
  EXPECT_FALSE(panel_->take_message().empty());
  EXPECT_THAT(kinds(), ElementsAre("name"));
  panel_->name_group(77);
  EXPECT_TRUE(panel_->act("open"));
  EXPECT_THAT(panel_->take_message(), HasSubstr("no group 77"));
}

TEST_F(PeoplePanelTest, MergesSplitsAndRestoresGroups) {
  panel_->act("groups");
  panel_->act("merge");
  EXPECT_THAT(panel_->take_message(), HasSubstr("mark"));
  panel_->act("mark");
  EXPECT_EQ(panel_->state()["rows"][0]["marked"], true);
  panel_->act("down");
  panel_->act("merge");
  EXPECT_THAT(rows(), ElementsAre(2));
  EXPECT_EQ(gallery_->group(2)->sightings, 5);
  panel_->act("open");
  EXPECT_EQ(panel_->list(), List::kFacesOfGroup);
  EXPECT_EQ(panel_->state()["of"], 2);
  EXPECT_THAT(rows(), SizeIs(5));
  panel_->act("mark");
  panel_->act("down");
  panel_->act("mark");
  panel_->act("split");
  EXPECT_THAT(rows(), SizeIs(3));
  EXPECT_THAT(kinds(), ElementsAre("split group", "merge groups"));
  EXPECT_TRUE(panel_->press(key_event(key::kEscape)));
  EXPECT_EQ(panel_->list(), List::kGroups);
  EXPECT_THAT(rows(), SizeIs(2));
  // The last but one is undone only after the last: said. Then both.
  panel_->act("log");
  EXPECT_EQ(panel_->list(), List::kCorrections);
  EXPECT_EQ(panel_->state()["chosen"], 0);
  panel_->act("down");
  panel_->act("undo");
  EXPECT_FALSE(panel_->take_message().empty());
  EXPECT_THAT(kinds(), SizeIs(2));
  panel_->act("up");
  panel_->act("undo");
  EXPECT_THAT(panel_->take_message(), HasSubstr("undone"));
  EXPECT_THAT(kinds(), SizeIs(3));
  EXPECT_EQ(gallery_->groups().size(), 1U);
}

TEST_F(PeoplePanelTest, MovesAndRejectsFacesOfAPerson) {
  panel_->act("people");
  EXPECT_EQ(panel_->state()["rows"][0]["title"], "Ann");
  panel_->act("open");
  EXPECT_EQ(panel_->state()["of"], "Ann");
  EXPECT_THAT(rows(), SizeIs(2));
  // A name that is not enrolled: a new person.
  panel_->act("mark");
  panel_->act("split");
  ASSERT_TRUE(panel_->is_typing());
  type("Ben");
  EXPECT_TRUE(panel_->press(key_event(key::kEnter)));
  EXPECT_EQ(gallery_->find("Ben")->faces, 1);
  EXPECT_THAT(rows(), SizeIs(1));
  panel_->act("not");
  EXPECT_THAT(rows(), IsEmpty());
  EXPECT_THAT(gallery_->negatives(), SizeIs(1));
  panel_->act("back");
  EXPECT_EQ(panel_->list(), List::kPeople);
  // The two are one.
  panel_->act("up");
  panel_->act("mark");
  panel_->act("down");
  panel_->act("merge");
  EXPECT_THAT(gallery_->people(), SizeIs(1));
  EXPECT_THAT(kinds(), ElementsAre("merge", "not", "split"));
}

TEST_F(PeoplePanelTest, ForgetAsksForConfirmation) {
  panel_->act("groups");
  panel_->act("forget");
  EXPECT_EQ(panel_->state()["asking"], true);
  EXPECT_TRUE(panel_->act("cancel"));
  EXPECT_FALSE(panel_->act("confirm"));  // nothing is asked
  EXPECT_THAT(rows(), SizeIs(2));
  panel_->act("forget");
  EXPECT_TRUE(panel_->press(key_event(key::kEscape)));
  EXPECT_EQ(panel_->list(), List::kGroups);
  EXPECT_FALSE(panel_->act("confirm"));
  panel_->act("forget");
  panel_->act("confirm");
  EXPECT_THAT(rows(), ElementsAre(2));
  EXPECT_THAT(panel_->take_message(), HasSubstr("no copy is left"));
  panel_->act("people");
  panel_->act("forget");
  panel_->act("confirm");
  EXPECT_THAT(gallery_->people(), IsEmpty());
  EXPECT_THAT(panel_->take_forgotten(), SizeIs(1));
  EXPECT_THAT(panel_->take_forgotten(), IsEmpty());
}

TEST_F(PeoplePanelTest, ReportsEntriesDeletedMeanwhile) {
  panel_->act("groups");
  face::people::Gallery other(path("p.db"));
  ASSERT_TRUE(other.forget_group(1, {}));
  panel_->act("name");
  panel_->press(key_event(key::kEnter));
  EXPECT_THAT(panel_->take_message(), HasSubstr("no group 1"));
  EXPECT_FALSE(panel_->take_changed());
  EXPECT_THAT(rows(), ElementsAre(2));
}

TEST_F(PeoplePanelTest, DrawsItselfAndHandlesClicks) {
  for (const cv::Size size : {cv::Size(560, 420), cv::Size(1280, 720), cv::Size(330, 420)}) {
    cv::Mat image(size, CV_8UC3, cv::Scalar::all(90));
    const cv::Rect area(120, 10, size.width - 130, size.height - 20);
    for (const char* list : {"groups", "people", "log"}) {
      panel_->act(list);
      const cv::Mat before = image.clone();
      panel_->draw(image, area);
      if (panel_->list() != List::kNone && area.width > 208) {
        EXPECT_GT(cv::norm(image(area), before(area), cv::NORM_INF), 20) << list;
      }
      EXPECT_EQ(cv::norm(image.colRange(0, area.x), before.colRange(0, area.x), cv::NORM_INF), 0);
      panel_->close();
    }
  }
  cv::Mat image(420, 560, CV_8UC3, cv::Scalar::all(90));
  const cv::Rect area(120, 10, 430, 400);
  panel_->act("groups");
  panel_->draw(image, area);
  const cv::Rect second = panel_->row_box(1);
  ASSERT_FALSE(second.empty());
  EXPECT_TRUE(panel_->row_box(2).empty());
  const cv::Point center = (second.tl() + second.br()) / 2;
  EXPECT_TRUE(panel_->click(center));
  EXPECT_EQ(panel_->state()["chosen"], 1);
  EXPECT_TRUE(panel_->click(center));  // chosen already: marked
  EXPECT_EQ(panel_->state()["rows"][1]["marked"], true);
  EXPECT_FALSE(panel_->click({5, 5}));
  panel_->act("open");
  panel_->draw(image, area);
  EXPECT_FALSE(panel_->row_box(1).empty());
  EXPECT_EQ(panel_->row_box(0).y, panel_->row_box(1).y);  // faces are in a grid
}

// The chosen row is in view, also of more rows than there is room for.
TEST_F(PeoplePanelTest, LongListsScroll) {
  for (int i = 0; i < 30; ++i) gallery_->enroll("P" + std::to_string(100 + i), "", stored(50 + i));
  cv::Mat image(420, 560, CV_8UC3, cv::Scalar::all(90));
  const cv::Rect area(120, 10, 430, 400);
  panel_->act("people");
  panel_->draw(image, area);
  EXPECT_FALSE(panel_->row_box(0).empty());
  EXPECT_TRUE(panel_->row_box(30).empty());
  for (int i = 0; i < 40; ++i) panel_->act("down");
  panel_->draw(image, area);
  EXPECT_TRUE(panel_->row_box(0).empty());
  EXPECT_FALSE(panel_->row_box(30).empty());
  EXPECT_LE(panel_->row_box(30).br().y, area.br().y);
}

}  // namespace
}  // namespace tarsier
