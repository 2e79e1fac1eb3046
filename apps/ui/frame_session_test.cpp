// SPDX-License-Identifier: MIT
#include "ui/frame_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "ui/testing_plain.h"
#include "ui/testing_source.h"
#include <nlohmann/json.hpp>

namespace tarsier {
namespace {

using test_support::live;
using ::testing::HasSubstr;
using ::testing::Not;

// Marks each frame with a value that an action raises.
class MarkingSession final : public FrameSession {
 public:
  MarkingSession() : FrameSession("Marks") {}
  int restarts = 0;
  int frames = 0;
  int drawings = 0;
  bool redraws_when_idle = false;  // when idle
  std::string message_text;
  bool draws_border = false;

 private:
  void restart() override { ++restarts; }
  void process(const Frame& frame) override {
    EXPECT_EQ(frame.image.data, this->frame().data);
    EXPECT_EQ(frame.still, still());
    ++frames;
  }
  void draw(cv::Mat& image) override {
    ++drawings;
    image.at<cv::Vec3b>(0, 0) = cv::Vec3b::all(value_);
  }
  [[nodiscard]] nlohmann::json state() const override { return {{"value", value_}}; }
  [[nodiscard]] std::string status() const override { return count_text(1, "mark"); }
  [[nodiscard]] std::vector<Action> own_actions() const override {
    return {{"raise", "a higher value", 'r'}, {"look", "changes nothing", 'l'}};
  }
  bool act(const std::string& name) override {
    if (name != "raise") return false;
    ++value_;
    return true;
  }
  bool mouse(const Event& event) override {
    if (event.mouse != Event::Mouse::kLeftDown) return false;
    value_ = static_cast<std::uint8_t>(event.x);
    return true;
  }
  bool idle() override { return redraws_when_idle; }
  void draw_shown(cv::Mat& image) override {
    if (draws_border) image.row(0).setTo(cv::Scalar::all(250));
  }
  [[nodiscard]] std::string message() const override { return message_text; }

  std::uint8_t value_ = 1;
};

Frame frame_of(const char* name, bool still) {
  Frame frame;
  frame.name = name;
  frame.still = still;
  frame.image = cv::Mat(120, 160, CV_8UC3, cv::Scalar::all(90));
  return frame;
}

SourceStatus stale() { return {.state = SourceState::kStale, .detail = "", .age_s = 3}; }

TEST(SessionControls, HandlesPauseHelpAndQuitAndListsThemLast) {
  SessionControls controls(true);
  const std::vector<Action> actions = controls.append_to({{"raise", "", 'r'}});
  ASSERT_EQ(actions.size(), 4U);
  EXPECT_EQ(actions[0].name, "raise");
  EXPECT_EQ(action_of(key_event(key::kSpace), actions), "pause");
  EXPECT_EQ(action_of(key_event('?'), actions), "help");
  EXPECT_EQ(action_of(key_event(key::kEscape), actions), "quit");
  EXPECT_FALSE(controls.act("raise"));
  EXPECT_TRUE(controls.act("pause"));
  EXPECT_TRUE(controls.paused());
  EXPECT_TRUE(controls.act("pause"));
  EXPECT_FALSE(controls.paused());
  EXPECT_TRUE(controls.act("help"));
  EXPECT_TRUE(controls.help());
  EXPECT_FALSE(controls.finished());
  EXPECT_TRUE(controls.act("quit"));
  EXPECT_TRUE(controls.finished());
}

TEST(SessionControls, HasNoPauseActionUnlessRequested) {
  SessionControls controls;
  EXPECT_EQ(action_of(key_event(key::kSpace), controls.append_to({})), "");
  EXPECT_FALSE(controls.act("pause"));
  EXPECT_FALSE(controls.paused());
}

TEST(SessionControls, PauseKeyIsConfigurable) {
  const SessionControls controls(true, 'p');
  const std::vector<Action> actions = controls.append_to({{"take", "", key::kSpace}});
  EXPECT_EQ(action_of(key_event('p'), actions), "pause");
  EXPECT_EQ(action_of(key_event(key::kSpace), actions), "take");
}

TEST(FrameSession, DrawsOnACopyAndTheBarOnlyOnTheShownImage) {
  MarkingSession session;
  const Frame frame = frame_of("video", false);
  const View view = session.on_frame(frame, live());
  EXPECT_EQ(view.output.at<cv::Vec3b>(0, 0), cv::Vec3b::all(1));
  EXPECT_EQ(frame.image.at<cv::Vec3b>(0, 0), cv::Vec3b::all(90));
  EXPECT_EQ(view.output.at<cv::Vec3b>(115, 80), cv::Vec3b::all(90));
  EXPECT_GT(cv::norm(view.image, view.output, cv::NORM_INF), 0);
  EXPECT_EQ(view.status, "1 mark");
  EXPECT_EQ(view.state, nlohmann::json({{"value", 1}, {"paused", false}}));
  EXPECT_FALSE(view.finished);
}

// Draws the frame beside something of its own.
class SideBySideSession final : public FrameSession {
 public:
  SideBySideSession() : FrameSession("Beside", 'p') {}
  View finish() { return redraw(); }
  std::string note_text = "";

 private:
  void process(const Frame& /*frame*/) override {}
  void draw(cv::Mat& image) override {
    image.create(120, 320, CV_8UC3);
    image.setTo(cv::Scalar::all(20));
    frame().copyTo(image(cv::Rect(0, 0, 160, 120)));
  }
  [[nodiscard]] nlohmann::json state() const override { return nlohmann::json::object(); }
  [[nodiscard]] std::string status() const override { return "beside"; }
  [[nodiscard]] std::string note() const override { return note_text; }
  [[nodiscard]] std::vector<image::draw::HelpLine> help_lines() const override {
    return {{"arrows", "turn it"}};
  }
};

TEST(FrameSession, CanDrawAnImageOfAnotherSize) {
  SideBySideSession session;
  EXPECT_TRUE(session.finish().output.empty()) << "no frame came";
  const Frame frame = frame_of("video", false);
  const cv::Mat first = session.on_frame(frame, live()).output.clone();
  EXPECT_EQ(first.size(), cv::Size(320, 120));
  EXPECT_EQ(first.at<cv::Vec3b>(60, 80), cv::Vec3b::all(90));
  EXPECT_EQ(first.at<cv::Vec3b>(60, 200), cv::Vec3b::all(20));
  EXPECT_EQ(cv::norm(session.on_frame(frame, live()).output, first, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(session.finish().output, first, cv::NORM_INF), 0);
}

TEST(FrameSession, PauseKeyNoteAndHelpLinesAreCustomizable) {
  SideBySideSession session;
  const cv::Mat plain_bar = session.on_frame(frame_of("video", false), live()).image.clone();
  session.note_text = "a note";
  const cv::Mat note_bar = session.on_frame(frame_of("video", false), live()).image.clone();
  EXPECT_GT(cv::norm(note_bar, plain_bar, cv::NORM_INF), 0);
  EXPECT_FALSE(session.on_event(key_event(key::kSpace)).state["paused"]);
  EXPECT_TRUE(session.on_event(key_event('p')).state["paused"]);
  const cv::Mat help = session.on_event(key_event('h')).image;
  EXPECT_GT(cv::norm(help, note_bar, cv::NORM_INF), 0);
}

TEST(FrameSession, ShowsNothingBeforeTheFirstFrame) {
  MarkingSession session;
  EXPECT_TRUE(session.on_idle(live()).image.empty());
  const View view = session.on_event(action_event("raise"));
  EXPECT_TRUE(view.image.empty());
  EXPECT_TRUE(view.output.empty());
  EXPECT_EQ(view.state["value"], 2);
  EXPECT_EQ(session.drawings, 0);
}

TEST(FrameSession, ActionsUpdateTheOutputOfStillsOnly) {
  for (const bool still : {true, false}) {
    MarkingSession session;
    (void)session.on_frame(frame_of("image", still), live());
    View view = session.on_event(key_event('r'));
    EXPECT_EQ(view.output.empty(), !still);
    EXPECT_EQ(view.image.at<cv::Vec3b>(0, 0), cv::Vec3b::all(2)) << "shown at once";
    view = session.on_event(key_event('l'));
    EXPECT_TRUE(view.output.empty()) << "nothing changed";
    EXPECT_EQ(session.frames, 1) << "drawing is not processing";
    EXPECT_EQ(session.drawings, 2);
  }
}

TEST(FrameSession, MouseEventsUpdateTheOutputOfStillsOnly) {
  Event press;
  press.kind = Event::Kind::kMouse;
  press.mouse = Event::Mouse::kLeftDown;
  press.x = 7;
  Event move = press;
  move.mouse = Event::Mouse::kMove;
  for (const bool still : {true, false}) {
    MarkingSession session;
    EXPECT_TRUE(session.on_event(press).image.empty()) << "before the first frame";
    (void)session.on_frame(frame_of("image", still), live());
    press.x = 9;
    const View view = session.on_event(press);
    EXPECT_EQ(view.output.empty(), !still);
    EXPECT_EQ(view.image.at<cv::Vec3b>(0, 0), cv::Vec3b::all(9));
    EXPECT_TRUE(session.on_event(move).output.empty()) << "nothing changed";
    EXPECT_EQ(session.drawings, 2);
  }
}

TEST(FrameSession, DrawShownDoesNotChangeTheOutput) {
  MarkingSession session;
  session.draws_border = true;
  View view = session.on_frame(frame_of("video", false), live());
  EXPECT_EQ(view.image.at<cv::Vec3b>(0, 80), cv::Vec3b::all(250));
  EXPECT_EQ(view.output.at<cv::Vec3b>(0, 80), cv::Vec3b::all(90));
  session.draws_border = false;
  view = session.on_idle(live());
  EXPECT_EQ(view.image.at<cv::Vec3b>(0, 80), cv::Vec3b::all(90)) << "it is gone without a frame";
}

TEST(FrameSession, MessageReplacesTheStatusOnlyInTheBar) {
  MarkingSession session;
  (void)session.on_frame(frame_of("image", true), live());
  const cv::Mat bar = session.on_idle(live()).image.clone();
  session.message_text = "saved a.png";
  const View view = session.on_idle(live());
  EXPECT_EQ(view.status, "1 mark");
  EXPECT_GT(cv::norm(view.image(cv::Rect(0, 60, 80, 60)), bar(cv::Rect(0, 60, 80, 60))), 0);
}

TEST(FrameSession, RestartsForEachStillAndEachSource) {
  MarkingSession session;
  for (const char* name : {"a", "a", "b"}) (void)session.on_frame(frame_of(name, false), live());
  EXPECT_EQ(session.restarts, 2);
  for (int i = 0; i < 2; ++i) (void)session.on_frame(frame_of("b", true), live());
  EXPECT_EQ(session.restarts, 4);
  // The images of a sequence are one source: that of their folder.
  for (const char* name : {"walk/1.png", "walk/2.png", "run/1.png"})
    (void)session.on_frame(frame_of(name, false), live());
  EXPECT_EQ(session.restarts, 6);
}

TEST(FrameSession, StatusHasSourceStateAndPause) {
  MarkingSession session;
  (void)session.on_frame(frame_of("camera", false), live());
  View view = session.on_idle(stale());
  EXPECT_EQ(view.status, "1 mark  " + std::string(name_of(SourceState::kStale)));
  EXPECT_TRUE(view.output.empty());
  EXPECT_EQ(session.drawings, 1);
  view = session.on_event(key_event(key::kSpace));
  EXPECT_THAT(view.status, HasSubstr("paused"));
  EXPECT_EQ(view.state["paused"], true);
  view = session.on_frame(frame_of("camera", false), live());
  EXPECT_THAT(view.status, Not(HasSubstr(std::string(name_of(SourceState::kStale)))));
  session.redraws_when_idle = true;
  (void)session.on_idle(stale());
  EXPECT_EQ(session.drawings, 2) << "what an idle session forgets leaves the image";
}

TEST(FrameSession, PauseFreezesALiveCamera) {
  MarkingSession session;
  (void)session.on_frame(frame_of("camera", false), live());
  (void)session.on_event(action_event("pause"));
  Frame later = frame_of("camera", false);
  later.image.setTo(cv::Scalar::all(30));
  View view = session.on_frame(later, live());
  EXPECT_EQ(session.frames, 1);
  EXPECT_TRUE(view.output.empty());
  EXPECT_EQ(view.image.at<cv::Vec3b>(60, 80), cv::Vec3b::all(90));
  (void)session.on_event(action_event("pause"));
  view = session.on_frame(later, live());
  EXPECT_EQ(session.frames, 2);
  EXPECT_EQ(view.image.at<cv::Vec3b>(60, 80), cv::Vec3b::all(30));
}

TEST(FrameSession, HelpIsDrawnOverTheViewAndQuitFinishes) {
  MarkingSession session;
  const View plain = session.on_frame(frame_of("video", false), live());
  const cv::Mat before = plain.image.clone();
  const View with_help = session.on_event(key_event('h'));
  EXPECT_GT(cv::norm(before, with_help.image, cv::NORM_INF), 0);
  EXPECT_TRUE(session.on_event(key_event('q')).finished);
}

TEST(FrameSession, WithoutStatusShowsOnlyTheDrawing) {
  MarkingSession session;
  const Frame frame = frame_of("video", false);
  session.draw_status(false);
  const View view = session.on_frame(frame, live());
  EXPECT_EQ(cv::norm(view.image, view.output, cv::NORM_INF), 0);
  test_support::expect_plain_image(session, live());
  // Paused, it is the newest drawing all the same, though there is nothing to write.
  (void)session.on_event(action_event("pause"));
  const View raised = session.on_event(action_event("raise"));
  EXPECT_TRUE(raised.output.empty());
  EXPECT_EQ(raised.image.at<cv::Vec3b>(0, 0), cv::Vec3b::all(2));
  session.message_text = "look here";
  EXPECT_EQ(session.on_idle(live()).status, "look here") << "what the bar would say";
}

}  // namespace
}  // namespace tarsier
