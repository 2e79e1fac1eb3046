// SPDX-License-Identifier: MIT
#include "ui/face/annotate_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ui/scripted_host.h"
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using Mouse = Event::Mouse;

cv::Mat test_image(int number, cv::Size size = {200, 150}) {
  cv::Mat image(size, CV_8UC3);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x)
      image.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>((x * 5 + number * 30) % 256),
                                   static_cast<std::uint8_t>((y * 3) % 256), 90};
  return image;
}

// A video of so many frames.
class TestVideo final : public FrameSource {
 public:
  explicit TestVideo(int count) : count_(count) {}
  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token&) override {
    if (at_ >= count_) return std::nullopt;
    Frame frame;
    frame.image = test_image(at_);
    frame.index = at_;
    frame.time = at_ / 10.0;
    frame.name = "video.avi";
    ++at_;
    return frame;
  }
  [[nodiscard]] bool ended() const override { return at_ >= count_; }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override { return {}; }
  [[nodiscard]] double fps() const override { return 10; }
  [[nodiscard]] std::int64_t count() const override { return count_; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  int count_;
  int at_ = 0;
  std::vector<std::string> skipped_;
};

Event mouse_event(Mouse kind, cv::Point2d at, bool shift = false) {
  Event event;
  event.kind = Event::Kind::kMouse;
  event.mouse = kind;
  event.x = at.x;
  event.y = at.y;
  event.shift = shift;
  return event;
}

class AnnotateSessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (int i = 0; i < 3; ++i) {
      const std::string path = folder_ / ("pic" + std::to_string(i) + ".png");
      write_image(path, test_image(i));
      options_.images.push_back(path);
    }
    options_.set_path = folder_ / "set.yaml";
  }
  // Clicks and drags in pixels of the image.
  static void click(AnnotateSession& session, cv::Point2d at, bool shift = false) {
    session.on_event(mouse_event(Mouse::kLeftDown, session.to_view(at), shift));
    session.on_event(mouse_event(Mouse::kLeftUp, session.to_view(at), shift));
  }
  static void drag(AnnotateSession& session, cv::Point2d from, cv::Point2d to, bool shift = false) {
    session.on_event(mouse_event(Mouse::kLeftDown, session.to_view(from), shift));
    session.on_event(mouse_event(Mouse::kMove, session.to_view(0.5 * (from + to)), shift));
    session.on_event(mouse_event(Mouse::kLeftUp, session.to_view(to), shift));
  }
  static View press(AnnotateSession& session, int key) { return session.on_event(key_event(key)); }
  static void four_points(AnnotateSession& session) {
    click(session, {40, 40});
    click(session, {120, 40});
    click(session, {80, 70});
    click(session, {80.5, 110.25});
  }
  [[nodiscard]] face::shape::LandmarkSet set() const {
    return face::shape::read_landmark_set(options_.set_path);
  }
  static Eigen::Vector2d point(const AnnotateSession& session, int test_image, int index) {
    return session.state().image(test_image).points.col(index);
  }

  TemporaryFolder folder_;
  AnnotateOptions options_;
};

TEST_F(AnnotateSessionTest, CreatesASetFromImages) {
  AnnotateSession session(options_, {});
  EXPECT_EQ(press(session, key::kTab).state.at("stage"), "points");
  four_points(session);
  EXPECT_NEAR(point(session, 0, 3).x(), 80.5, 1e-6) << "between pixels";
  EXPECT_NEAR(point(session, 0, 3).y(), 110.25, 1e-6);
  press(session, key::kEnter);
  click(session, {40, 40});
  click(session, {80, 70});
  press(session, key::kEnter);
  click(session, {40, 40});
  click(session, {120, 40});
  click(session, {80, 70});
  click(session, {80, 70});
  click(session, {80.5, 110.25});
  click(session, {80.5, 110.25});
  View view = press(session, key::kEnter);
  EXPECT_EQ(view.state.at("stage"), "images");
  EXPECT_EQ(view.state.at("image"), 1) << "the first is done";
  view = session.on_idle({});
  EXPECT_EQ(view.state.at("shown"), 4) << "something to drag";
  drag(session, {40, 40}, {55.5, 47.25});
  EXPECT_NEAR(point(session, 1, 0).x(), 55.5, 1e-6);
  press(session, key::kEnter);
  session.on_idle({});
  press(session, key::kEnter);
  session.finish();
  const face::shape::LandmarkSet result = set();
  ASSERT_EQ(result.samples.size(), 3u);
  EXPECT_EQ(result.samples[0].image, "pic0.png") << "beside the set";
  EXPECT_NEAR(result.samples[1].points(0, 0), 55.5, 1e-6);
  EXPECT_EQ(result.mirror, (std::vector<int>{1, 0, 2, 3}));
  ASSERT_EQ(result.connections.size(), 1u);
  EXPECT_EQ(result.connections[0], (std::array<int, 2>{0, 2}));
  EXPECT_FALSE(fs::exists(options_.set_path + ".journal")) << "nothing is left for it";
}

TEST_F(AnnotateSessionTest, ContinuesAfterARunThatWasNotFinished) {
  {
    AnnotateSession session(options_, {});
    four_points(session);
    press(session, key::kEnter);
    click(session, {40, 40});
    click(session, {120, 40});
  }  // no finish()
  EXPECT_FALSE(fs::exists(options_.set_path));
  {
    AnnotateSession session(options_, {});
    const View view = session.on_idle({});
    EXPECT_EQ(view.state.at("stage"), "connections");
    EXPECT_EQ(view.state.at("points"), 4);
    EXPECT_NE(view.status.find("last run"), std::string::npos);
    ASSERT_EQ(session.state().connections().size(), 1u);
    press(session, '5');
    session.on_idle({});
    drag(session, {120, 40}, {100, 50});
  }
  std::ofstream(options_.set_path + ".journal", std::ios::app) << "{\"why\":\"mo";
  AnnotateSession session(options_, {});
  EXPECT_NEAR(point(session, 1, 1).x(), 100, 1e-6);
  EXPECT_FALSE(session.state().image(1).done) << "nobody agreed";
  EXPECT_EQ(session.state().stage(), AnnotateStage::kImages);
}

TEST_F(AnnotateSessionTest, WritesTheSetEveryFewEdits) {
  options_.save_every = 3;
  {
    AnnotateSession session(options_, {});
    four_points(session);
  }
  EXPECT_EQ(set().points(), 3) << "the first three edits";
  AnnotateSession session(options_, {});
  EXPECT_EQ(session.state().points(), 4) << "and the journal has the fourth";
  EXPECT_EQ(session.state().stage(), AnnotateStage::kPoints);
}

TEST_F(AnnotateSessionTest, RefusesASecondProgram) {
  AnnotateSession session(options_, {});
  EXPECT_THROW(AnnotateSession(options_, {}), InputError);
}

TEST_F(AnnotateSessionTest, UndoesAndRedoes) {
  AnnotateSession session(options_, {});
  four_points(session);
  drag(session, {40, 40}, {44, 44});
  EXPECT_EQ(press(session, 'u').state.at("points"), 4);
  EXPECT_NEAR(point(session, 0, 0).x(), 40, 1e-6);
  press(session, 'u');
  Event undo = key_event('z');
  undo.control = true;
  EXPECT_EQ(session.on_event(undo).state.at("points"), 2);
  Event redo = key_event('y');
  redo.control = true;
  session.on_event(redo);
  press(session, 'r');
  press(session, 'r');
  EXPECT_NEAR(point(session, 0, 0).x(), 44, 1e-6);
  EXPECT_NE(press(session, 'r').status.find("Nothing to redo"), std::string::npos);
  press(session, 'u');
  click(session, {10, 10});
  EXPECT_NE(press(session, 'r').status.find("Nothing to redo"), std::string::npos)
      << "a new edit ends what could come back";
  // What was undone stays undone after the end, too.
  session.finish();
  EXPECT_EQ(set().points(), 5);
  EXPECT_NEAR(set().samples[0].points(0, 0), 40, 1e-6);
}

TEST_F(AnnotateSessionTest, UndoOpensTheChangedImage) {
  AnnotateSession session(options_, {});
  four_points(session);
  press(session, '5');
  session.on_idle({});
  drag(session, {40, 40}, {60, 60});
  press(session, 'n');  // touched: agreed
  EXPECT_TRUE(session.state().image(1).done);
  session.on_idle({});
  EXPECT_EQ(session.current(), 2);
  press(session, 'u');
  EXPECT_EQ(session.current(), 1);
  EXPECT_FALSE(session.state().image(1).done);
  EXPECT_TRUE(session.state().image(2).has_points()) << "a proposal elsewhere stays";
  press(session, 'u');
  EXPECT_NEAR(point(session, 1, 0).x(), 40, 1e-6);
}

TEST_F(AnnotateSessionTest, DeletesPointsOnTheFirstImageAndHidesThemOnOthers) {
  AnnotateSession session(options_, {});
  four_points(session);
  click(session, {120, 40});
  press(session, key::kDelete);
  EXPECT_EQ(session.state().points(), 3);
  EXPECT_NEAR(point(session, 0, 1).y(), 70, 1e-6);
  press(session, '5');
  session.on_idle({});
  click(session, {80, 70});
  press(session, 'd');
  EXPECT_EQ(session.state().points(), 3);
  EXPECT_FALSE(session.state().image(1).is_shown(1));
  press(session, key::kEnter);
  session.finish();
  EXPECT_TRUE(set().samples.at(1).is_missing(1));
  EXPECT_TRUE(set().samples.at(0).is_complete());
  // Shown again where it was.
  press(session, 'p');
  click(session, {80, 70});
  press(session, 'h');
  EXPECT_TRUE(session.state().image(session.current()).is_shown(1));
}

TEST_F(AnnotateSessionTest, EstimatesThePositionOfAHiddenPointWhenShown) {
  {
    AnnotateSession session(options_, {});
    four_points(session);
    press(session, '5');
    session.on_idle({});
    drag(session, {100, 100}, {110, 105}, true);  // all points
    click(session, {90, 75});
    press(session, 'h');
    press(session, key::kEnter);
    session.finish();
  }
  fs::remove(options_.set_path + ".journal");
  AnnotateSession session(options_, {});
  ASSERT_FALSE(session.state().image(1).is_shown(2));
  press(session, 'p');
  while (session.current() != 1) press(session, 'n');
  click(session, {90, 75});
  press(session, 'h');
  ASSERT_TRUE(session.state().image(1).is_shown(2));
  EXPECT_NEAR(point(session, 1, 2).x(), 90, 0.01);
  EXPECT_NEAR(point(session, 1, 2).y(), 75, 0.01);
}

TEST_F(AnnotateSessionTest, ArrowsMoveAPointByAQuarterPixelWhenZoomedIn) {
  AnnotateSession session(options_, {});
  four_points(session);
  click(session, {80, 70});
  for (int i = 0; i < 10; ++i) press(session, '+');
  press(session, key::kRight);
  EXPECT_NEAR(point(session, 0, 2).x(), 80.25, 1e-6);
  press(session, key::kUp);
  EXPECT_NEAR(point(session, 0, 2).y(), 69.75, 1e-6);
  press(session, 'm');
  press(session, key::kRight);
  EXPECT_NEAR(point(session, 0, 2).x(), 80, 1e-6) << "mirrored: right on the screen";
}

TEST_F(AnnotateSessionTest, ToViewMatchesTheDrawingAtAnyZoomAndMirrored) {
  AnnotateSession session(options_, {});
  four_points(session);
  press(session, 'i');  // no numbers
  press(session, 'g');  // no magnifier
  const auto look = [&](const char* what) {
    View view = session.on_idle({});
    const cv::Point2d at = session.to_view({80, 70});
    const cv::Vec3b color = view.image.at<cv::Vec3b>(cvRound(at.y), cvRound(at.x));
    EXPECT_GT(color[1], 150) << what << ": a green point is drawn there";
    EXPECT_LT(color[2], 150) << what;
  };
  look("whole");
  Event wheel = mouse_event(Mouse::kWheel, session.to_view({90, 80}));
  wheel.wheel = 4;
  const cv::Point2d before = session.to_view({90, 80});
  session.on_event(wheel);
  EXPECT_LT(cv::norm(before - session.to_view({90, 80})), 1e-6) << "zooms around the pointer";
  look("near");
  session.on_event(mouse_event(Mouse::kRightDown, {500, 300}));
  session.on_event(mouse_event(Mouse::kMove, {540, 310}));
  session.on_event(mouse_event(Mouse::kRightUp, {540, 310}));
  EXPECT_NEAR(session.to_view({90, 80}).x, before.x + 40, 1e-6) << "the image comes along";
  look("moved");
  press(session, 'm');
  look("mirrored");
  press(session, '0');
  look("whole again");
}

TEST_F(AnnotateSessionTest, TreatsADoubleClickAsTwoClicks) {
  AnnotateSession session(options_, {});
  const cv::Point2d a = session.to_view({20, 20});
  const cv::Point2d b = session.to_view({60, 60});
  session.on_event(mouse_event(Mouse::kLeftDown, a));
  session.on_event(mouse_event(Mouse::kLeftUp, a));
  session.on_event(mouse_event(Mouse::kDouble, b));  // instead of a press
  session.on_event(mouse_event(Mouse::kLeftUp, b));
  EXPECT_EQ(session.state().points(), 2);
  const cv::Point2d c = session.to_view({90, 90});
  session.on_event(mouse_event(Mouse::kLeftDown, c));
  session.on_event(mouse_event(Mouse::kDouble, c));  // besides the press
  session.on_event(mouse_event(Mouse::kLeftUp, c));
  EXPECT_EQ(session.state().points(), 3);
}

TEST_F(AnnotateSessionTest, ProposesPointsFromTheFinishedImages) {
  int calls = 0;
  face::ProposalRequest last;
  const PointProposer propose =
      [&](const face::ProposalRequest& request) -> std::optional<Eigen::Matrix2Xd> {
    ++calls;
    last = request;
    Eigen::Matrix2Xd points = request.annotated.samples[0].points;
    points.array() += 7;
    return points;
  };
  AnnotateSession session(options_, propose);
  four_points(session);
  View view = press(session, '5');
  EXPECT_TRUE(view.state.at("learning")) << "reported before it is done";
  EXPECT_EQ(calls, 0);
  view = session.on_idle({});
  EXPECT_EQ(calls, 1);
  EXPECT_NEAR(point(session, 1, 0).x(), 47, 1e-6);
  EXPECT_FALSE(view.state.at("agreed"));
  EXPECT_EQ(last.annotated.samples.size(), 1u);
  press(session, key::kEnter);
  session.on_idle({});
  EXPECT_EQ(last.annotated.samples.size(), 2u);
  EXPECT_EQ(last.nearest, 1);
  press(session, 'p');
  EXPECT_EQ(calls, 2) << "what has points is not proposed again";
  press(session, 'a');
  session.on_idle({});
  EXPECT_EQ(calls, 3) << "but when asked";
  session.finish();
  EXPECT_EQ(set().samples.size(), 1u) << "what nobody agreed to is not in the set";
}

TEST_F(AnnotateSessionTest, ReplacesUntouchedProposalsOnly) {
  const PointProposer propose =
      [](const face::ProposalRequest& request) -> std::optional<Eigen::Matrix2Xd> {
    Eigen::Matrix2Xd points = request.annotated.samples[0].points;
    points.array() += static_cast<double>(request.annotated.samples.size());
    return points;
  };
  AnnotateSession session(options_, propose);
  four_points(session);
  press(session, '5');
  session.on_idle({});
  press(session, 'n');
  session.on_idle({});
  EXPECT_NEAR(point(session, 2, 0).x(), 41, 1e-6);
  press(session, 'p');
  press(session, key::kEnter);
  session.on_idle({});
  EXPECT_EQ(session.current(), 2);
  EXPECT_NEAR(point(session, 2, 0).x(), 42, 1e-6);
  // What was put right stays, agreed to or not, and after a new start.
  drag(session, {42, 42}, {50, 50});
  session.finish();
  EXPECT_TRUE(fs::exists(options_.set_path + ".journal"));
  press(session, 'p');
  press(session, 'n');
  session.on_idle({});
  EXPECT_NEAR(point(session, 2, 0).x(), 50, 1e-6);
}

TEST_F(AnnotateSessionTest, ZoomToPointsShowsAllPoints) {
  AnnotateSession session(options_, {});
  four_points(session);
  EXPECT_GT(press(session, 'f').state.at("zoom"), 1.2);
  for (int i = 0; i < 4; ++i) {
    const cv::Point2d at = session.to_view({point(session, 0, i).x(), point(session, 0, i).y()});
    EXPECT_TRUE(cv::Rect(0, 0, 1024, 660).contains(at)) << i;
  }
}

TEST_F(AnnotateSessionTest, IgnoresInvalidProposalsAndErrors) {
  int kind = 0;
  const PointProposer propose =
      [&](const face::ProposalRequest&) -> std::optional<Eigen::Matrix2Xd> {
    if (kind == 0) return Eigen::Matrix2Xd::Zero(2, 99);
    if (kind == 1) return Eigen::Matrix2Xd::Constant(2, 4, std::nan(""));
    throw InputError("x", "gone");
  };
  AnnotateSession session(options_, propose);
  four_points(session);
  press(session, '5');
  for (kind = 0; kind < 3; ++kind) {
    session.on_idle({});
    EXPECT_NEAR(point(session, 1, 0).x(), 40, 1e-6);
    press(session, 'a');
  }
}

TEST_F(AnnotateSessionTest, ReportsUnreadableImages) {
  std::ofstream(options_.images[1]) << "no image";
  AnnotateSession session(options_, {});
  four_points(session);
  View view = press(session, '5');
  EXPECT_NE(view.status.find("pic1.png"), std::string::npos) << view.status;
  click(session, {40, 40});
  view = press(session, 'n');
  session.on_idle({});
  EXPECT_EQ(session.state().image(2).has_points(), true);
  EXPECT_FALSE(session.state().image(1).has_points());
}

TEST_F(AnnotateSessionTest, SavesPickedVideoFramesBesideTheSet) {
  options_.images.clear();
  options_.video = true;
  AnnotateSession session(options_, {});
  TestVideo video(6);
  ScriptedHost host(session, video);
  host.schedule(2, key_event('s'));
  host.schedule(3, key_event('s'));
  host.schedule(3, key_event('s'));  // again
  host.schedule(5, action_event("pick"));
  const auto& steps = host.run();
  EXPECT_TRUE(session.wants_frame());
  session.video_ended();
  EXPECT_FALSE(session.wants_frame());
  EXPECT_EQ(session.state().images(), 3);
  EXPECT_EQ(steps.back().state.at("frame"), 5);
  const std::string path = folder_ / "set-frames/frame-000002.png";
  ASSERT_TRUE(fs::exists(path));
  EXPECT_EQ(cv::norm(read_image(path), test_image(2), cv::NORM_INF), 0) << "as it was in the video";
  press(session, key::kEnter);
  four_points(session);
  session.finish();
  EXPECT_EQ(set().samples.at(0).image, "set-frames/frame-000001.png");
}

TEST_F(AnnotateSessionTest, KeepsPickedFramesAfterARestart) {
  options_.images.clear();
  options_.video = true;
  {
    AnnotateSession session(options_, {});
    TestVideo video(3);
    ScriptedHost host(session, video);
    host.schedule(1, key_event('s'));
    host.schedule(3, key_event('s'));
    host.run();
  }
  AnnotateSession session(options_, {});
  EXPECT_EQ(session.state().images(), 2);
  EXPECT_EQ(session.state().stage(), AnnotateStage::kPick) << "where it stopped";
}

TEST_F(AnnotateSessionTest, StepsAPausedVideoBothWays) {
  options_.images.clear();
  options_.video = true;
  AnnotateSession session(options_, {});
  TestVideo video(9);
  const auto feed = [&] { return session.on_frame(*video.next({}, {}), {}); };
  for (int i = 0; i < 4; ++i) feed();
  press(session, key::kSpace);
  EXPECT_FALSE(session.wants_frame());
  EXPECT_EQ(press(session, key::kLeft).state.at("frame"), 2);
  EXPECT_EQ(press(session, key::kRight).state.at("frame"), 3);
  press(session, key::kRight);
  EXPECT_TRUE(session.wants_frame());
  EXPECT_EQ(feed().state.at("frame"), 4);
  EXPECT_FALSE(session.wants_frame()) << "one only";
}

TEST_F(AnnotateSessionTest, ActionNamesAndKeysAreUnique) {
  const AnnotateSession session(options_, {});
  std::set<std::string> names;
  std::set<int> keys;
  for (const Action& action : session.actions()) {
    EXPECT_TRUE(names.insert(action.name).second) << action.name;
    EXPECT_TRUE(keys.insert(action.key).second) << action.name;
    EXPECT_FALSE(action.help.empty());
  }
}

TEST_F(AnnotateSessionTest, AcceptsAnyKeyInAnyStage) {
  AnnotateSession session(options_, {});
  four_points(session);
  std::vector<int> keys{key::kLeft, key::kRight, key::kUp,        key::kDown,
                        key::kTab,  'x',         key::kBackspace, key::kDelete};
  for (const Action& action : session.actions())
    if (action.name != "quit" && !action.name.starts_with("stage")) keys.push_back(action.key);
  for (const char stage : std::string("12345")) {
    press(session, stage);
    click(session, {33, 22});
    for (const int key : keys) EXPECT_FALSE(press(session, key).finished) << key;
  }
  EXPECT_FALSE(press(session, 'x').finished);
  EXPECT_TRUE(press(session, key::kEscape).finished);
}

TEST_F(AnnotateSessionTest, RefusesAFileOfAnotherType) {
  std::ofstream(options_.set_path) << "{\"type\": \"shape-model\"}";
  EXPECT_THROW(AnnotateSession(options_, {}), InputError);
}

}  // namespace
}  // namespace tarsier
