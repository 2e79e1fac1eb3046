// SPDX-License-Identifier: MIT
#include "ui/cartoon/cartoon_session.h"

#include "tarsier/core/errors.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "ui/testing_plain.h"
#include "ui/testing_source.h"
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <unistd.h>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using test_support::live;

// A scene with edges and texture, the same for the same number.
cv::Mat scene(int number = 0) {
  cv::Mat image(120, 160, CV_8UC3);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const bool inside = x > 30 + number && x < 90 + number && y > 30 && y < 90;
      const int texture = (x * 7 + y * 13) % 9;
      image.at<cv::Vec3b>(y, x) =
          inside ? cv::Vec3b(40, 60, static_cast<std::uint8_t>(200 + texture))
                 : cv::Vec3b(180, static_cast<std::uint8_t>(150 + texture), 120);
    }
  }
  return image;
}

Frame moving(int index, double fps = 10) {
  Frame frame;
  frame.image = scene(index);
  frame.index = index;
  frame.time = index / fps;
  frame.name = "synthetic";
  return frame;
}

Frame still(const std::string& name = "a.png") {
  Frame frame;
  frame.image = scene();
  frame.name = name;
  frame.still = true;
  return frame;
}

double max_difference(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF); }

class CartoonSessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() /
              ("cartoon-session-" + std::to_string(getpid()) + "-" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    options_.save_folder = folder_.string();
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path folder_;
  CartoonSessionOptions options_;
  const cartoon::Cartoonizer cartoonizer_ = cartoon::Cartoonizer::load({});
};

TEST_F(CartoonSessionTest, KeysSelectModes) {
  CartoonSession session(cartoonizer_, options_);
  View view = session.on_frame(moving(0), live());
  EXPECT_EQ(view.state.at("mode"), "cartoon");
  const std::pair<char, const char*> keys[] = {
      {'s', "sketch"}, {'p', "paint"}, {'c', "cartoon"}, {'e', "evil"}, {'e', "evil-sketch"},
      {'e', "evil"},   {'a', "alien"}, {'m', "smooth"},  {'n', "none"}, {'S', "sketch"}};
  int index = 1;
  for (const auto& [key, mode] : keys) {
    session.on_event(key_event(key));
    view = session.on_frame(moving(index++), live());
    EXPECT_EQ(view.state.at("mode"), mode) << key;
    ASSERT_EQ(view.output.size(), cv::Size(160, 120));
    EXPECT_NE(view.status.find(mode), std::string::npos);
  }
}

TEST_F(CartoonSessionTest, ActionsSelectModesByName) {
  CartoonSession session(cartoonizer_, options_);
  for (const cartoon::Mode mode : cartoon::all_modes()) {
    const View view = session.on_event(action_event(std::string(cartoon::name_of(mode))));
    EXPECT_EQ(view.state.at("mode"), cartoon::name_of(mode));
  }
  session.on_event(action_event("evil"));
  EXPECT_EQ(session.on_event(action_event("evil")).state.at("mode"), "evil")
      << "scripts say what they mean";
}

TEST_F(CartoonSessionTest, ActionNamesAndKeysAreUnique) {
  const CartoonSession session(cartoonizer_, options_);
  std::set<std::string> names;
  std::set<int> keys;
  for (const Action& action : session.actions()) {
    EXPECT_TRUE(names.insert(action.name).second) << action.name;
    EXPECT_FALSE(action.help.empty()) << action.name;
    if (action.key != 0) {
      EXPECT_TRUE(keys.insert(action.key).second) << action.name;
    }
  }
}

TEST_F(CartoonSessionTest, ModesDrawDifferentImages) {
  CartoonSession session(cartoonizer_, options_);
  const cv::Mat cartoon = session.on_frame(still(), {}).output.clone();
  const cv::Mat sketch = session.on_event(key_event('s')).output.clone();
  const cv::Mat none = session.on_event(key_event('n')).output.clone();
  ASSERT_FALSE(sketch.empty()) << "a still is drawn again at once";
  EXPECT_GT(max_difference(cartoon, sketch), 50);
  EXPECT_EQ(max_difference(none, scene()), 0);
}

TEST_F(CartoonSessionTest, OverlaysAreNotInTheOutput) {
  CartoonSessionOptions plain = options_;
  plain.overlay = false;
  CartoonSession shown(cartoonizer_, options_);
  CartoonSession without_overlay(cartoonizer_, plain);
  SourceStatus stale = live(4);
  stale.state = SourceState::kStale;
  stale.detail = "no frame for 4 s";
  shown.on_event(key_event('h'));
  const View with = shown.on_frame(moving(0), stale);
  const View without = without_overlay.on_frame(moving(0), stale);
  EXPECT_EQ(max_difference(with.output, without.output), 0);
  EXPECT_GT(max_difference(with.image, with.output), 50)
      << "status, banner and help are on the shown image";
  EXPECT_EQ(max_difference(without.image, without.output), 0);
}

TEST_F(CartoonSessionTest, PauseFreezesAndResumes) {
  CartoonSession session(cartoonizer_, options_);
  const cv::Mat before = session.on_frame(moving(0), live()).output.clone();
  EXPECT_TRUE(session.on_event(key_event(key::kSpace)).state.at("paused"));
  View view = session.on_frame(moving(20), live());
  EXPECT_TRUE(view.output.empty());
  EXPECT_EQ(view.state.at("frame"), 0);
  EXPECT_NE(view.status.find("paused"), std::string::npos);
  // Another mode shows on the frozen image.
  view = session.on_event(key_event('s'));
  EXPECT_TRUE(view.output.empty());
  EXPECT_GT(cv::mean(view.image)[0], cv::mean(before)[0]) << "a sketch is mostly white";
  session.on_event(key_event(key::kSpace));
  view = session.on_frame(moving(21), live());
  EXPECT_FALSE(view.output.empty());
  EXPECT_EQ(view.state.at("frame"), 21);
}

TEST_F(CartoonSessionTest, PauseBeforeTheFirstFrameShowsThatFrame) {
  CartoonSession session(cartoonizer_, options_);
  session.on_event(key_event(key::kSpace));
  EXPECT_FALSE(session.on_frame(moving(0), live()).output.empty());
  EXPECT_TRUE(session.on_frame(moving(1), live()).output.empty());
}

TEST_F(CartoonSessionTest, SavesUnderTheNextUnusedNumber) {
  CartoonSession session(cartoonizer_, options_);
  EXPECT_EQ(session.on_event(key_event('w')).state.count("saved"), 0u) << "nothing to save yet";
  session.on_frame(moving(0), live());
  session.on_event(key_event('w'));
  EXPECT_TRUE(fs::exists(folder_ / "tarsier-0001.png"));
  std::ofstream(folder_ / "tarsier-0002.png") << "something else";
  const View view = session.on_event(action_event("save"));
  EXPECT_EQ(view.state.at("saved"), (folder_ / "tarsier-0003.png").string());
  EXPECT_NE(view.status.find("tarsier-0003.png"), std::string::npos);
  EXPECT_EQ(fs::file_size(folder_ / "tarsier-0002.png"), 14u) << "not touched";
}

TEST_F(CartoonSessionTest, ReportsAFailedSaveAndContinues) {
  fs::create_directories(folder_);
  std::ofstream(folder_ / "file") << "no folder";
  options_.save_folder = (folder_ / "file").string();
  CartoonSession session(cartoonizer_, options_);
  session.on_frame(moving(0), live());
  const View view = session.on_event(key_event('w'));
  EXPECT_NE(view.status.find("cannot save"), std::string::npos);
  EXPECT_FALSE(view.finished);
}

TEST_F(CartoonSessionTest, TheFaceOutlineFadesByFrameTime) {
  CartoonSession session(cartoonizer_, options_);
  session.on_frame(moving(0), live());
  session.on_event(key_event('a'));
  const auto yellow = [](const cv::Mat& image) {
    cv::Mat found;
    cv::inRange(image, cv::Scalar(0, 200, 200), cv::Scalar(120, 255, 255), found);
    return cv::countNonZero(found);
  };
  const View first = session.on_frame(moving(1), live());
  const int at_once = yellow(first.image);
  EXPECT_GT(at_once, 30);
  EXPECT_EQ(yellow(first.output), 0) << "not on the output";
  EXPECT_EQ(yellow(session.on_frame(moving(15), live()).image), 0) << "half gone after 1.4 s";
  cv::Mat late = session.on_frame(moving(23), live()).image.clone();
  CartoonSession without(cartoonizer_, options_);
  without.on_event(key_event('a'));
  without.on_frame(moving(0), live());
  cv::Mat expected = without.on_frame(moving(23), live()).image;
  EXPECT_EQ(max_difference(late(cv::Rect(0, 0, 160, 85)), expected(cv::Rect(0, 0, 160, 85))), 0)
      << "gone after two seconds";
}

TEST_F(CartoonSessionTest, StillsHaveNoFaceOutline) {
  CartoonSession session(cartoonizer_, options_);
  session.on_frame(still(), live(0));
  const View view = session.on_event(key_event('a'));
  EXPECT_EQ(
      max_difference(view.image(cv::Rect(0, 0, 160, 85)), view.output(cv::Rect(0, 0, 160, 85))), 0);
}

TEST_F(CartoonSessionTest, DebugViewShowsAllStages) {
  struct StageCounter final : DebugSink {
    void image(std::string_view name, const cv::Mat& image) override {
      EXPECT_FALSE(image.empty()) << name;
      names.emplace(name);
    }
    std::set<std::string> names;
  } counter;
  options_.debug = &counter;
  CartoonSession session(cartoonizer_, options_);
  const View plain = session.on_frame(moving(0), live());
  const cv::Mat before = plain.image.clone();
  EXPECT_GE(counter.names.size(), 4u) << "the given sink gets them without the debug view, too";
  EXPECT_TRUE(session.on_event(key_event('d')).state.at("debug"));
  const View view = session.on_frame(moving(0), live());
  EXPECT_EQ(view.image.size(), before.size());
  EXPECT_GT(max_difference(view.image, before), 100);
  session.on_event(key_event('d'));
  EXPECT_FALSE(session.on_frame(moving(1), live()).state.at("debug"));
}

TEST_F(CartoonSessionTest, ComputesStagesOnlyIfWatched) {
  struct SwitchedSink final : DebugSink {
    void image(std::string_view, const cv::Mat&) override { ++count; }
    [[nodiscard]] bool is_watched() const override { return watched; }
    bool watched = false;
    int count = 0;
  } sink;
  options_.debug = &sink;
  CartoonSession session(cartoonizer_, options_);
  (void)session.on_frame(moving(0), live());
  EXPECT_EQ(sink.count, 0);
  sink.watched = true;
  (void)session.on_frame(moving(1), live());
  EXPECT_GE(sink.count, 4);
}

TEST_F(CartoonSessionTest, MeasuresFpsByFrameTimes) {
  CartoonSession session(cartoonizer_, options_);
  EXPECT_EQ(session.on_frame(moving(0, 25), live()).state.at("fps"), 0.0);
  View view;
  for (int i = 1; i < 10; ++i) view = session.on_frame(moving(i, 25), live());
  EXPECT_NEAR(view.state.at("fps").get<double>(), 25, 0.01);
  for (int i = 10; i < 80; ++i) view = session.on_frame(moving(i, 25), live());
  EXPECT_NE(view.status.find("25.0 fps"), std::string::npos) << view.status;
}

TEST_F(CartoonSessionTest, ReportsTheSourceState) {
  CartoonSession session(cartoonizer_, options_);
  SourceStatus status;
  status.state = SourceState::kConnecting;
  status.detail = "http://camera/";
  View view = session.on_idle(status);
  EXPECT_EQ(view.state.at("source"), "connecting");
  EXPECT_EQ(view.state.at("frame"), -1);
  EXPECT_FALSE(view.image.empty()) << "something to look at before the first frame";
  EXPECT_TRUE(view.output.empty());
  view = session.on_frame(moving(0), live(0.05));
  EXPECT_EQ(view.state.at("source"), "live");
  EXPECT_GE(view.state.at("age_ms").get<double>(), 50);
  const cv::Mat live_view = view.image.clone();
  status.state = SourceState::kStale;
  status.age_s = 3;
  view = session.on_idle(status);
  EXPECT_EQ(view.state.at("source"), "stale");
  EXPECT_EQ(view.state.at("age_ms"), 3000.0);
  EXPECT_GT(max_difference(view.image(cv::Rect(0, 0, 160, 60)), live_view(cv::Rect(0, 0, 160, 60))),
            50)
      << "a banner";
}

TEST_F(CartoonSessionTest, StateHasAllDocumentedKeys) {
  CartoonSession session(cartoonizer_, options_);
  const View view = session.on_frame(moving(3), live());
  for (const char* key : {"mode", "fps", "age_ms", "source", "paused", "debug", "steady", "help",
                          "faces", "frame", "ms", "sketch_threshold", "evil_threshold"}) {
    EXPECT_TRUE(view.state.contains(key)) << key;
  }
  EXPECT_EQ(view.state.at("frame"), 3);
  EXPECT_TRUE(view.state.at("faces").is_array());
}

TEST_F(CartoonSessionTest, KeysAndSlidersChangeThresholds) {
  CartoonSession session(cartoonizer_, options_);
  EXPECT_EQ(session.on_event(key_event('+')).state.at("sketch_threshold"), 85);
  EXPECT_EQ(session.on_event(key_event('-')).state.at("sketch_threshold"), 80);
  session.on_event(key_event('e'));
  EXPECT_EQ(session.on_event(key_event('=')).state.at("evil_threshold"), 13);
  EXPECT_EQ(session.on_event(slider_event("sketch-threshold", 1e9)).state.at("sketch_threshold"),
            255);
  EXPECT_EQ(session.on_event(slider_event("evil-threshold", 30)).state.at("evil_threshold"), 30);
  const std::vector<Slider> sliders = session.sliders();
  ASSERT_EQ(sliders.size(), 2u);
  EXPECT_EQ(sliders[0].value, 255);
  EXPECT_EQ(sliders[1].value, 30);
  for (int i = 0; i < 300; ++i) session.on_event(key_event('-'));
  EXPECT_EQ(session.sliders()[1].value, 0);
}

TEST_F(CartoonSessionTest, UnknownEventsChangeNothing) {
  CartoonSession session(cartoonizer_, options_);
  const View before = session.on_frame(moving(0), live());
  const nlohmann::json state = before.state;
  EXPECT_EQ(session.on_event(action_event("fly")).state, state);
  EXPECT_EQ(session.on_event(key_event('z')).state, state);
  EXPECT_EQ(session.on_event(slider_event("volume", 3)).state, state);
  Event mouse;
  mouse.kind = Event::Kind::kMouse;
  EXPECT_EQ(session.on_event(mouse).state, state);
}

TEST_F(CartoonSessionTest, RequestsQuitAndFullScreenFromTheHost) {
  for (const int key : {key::kEscape, static_cast<int>('q')}) {
    CartoonSession session(cartoonizer_, options_);
    EXPECT_TRUE(session.on_event(key_event(key)).finished);
  }
  CartoonSession session(cartoonizer_, options_);
  EXPECT_TRUE(session.on_event(key_event('f')).toggle_fullscreen);
  EXPECT_FALSE(session.on_event(key_event('s')).toggle_fullscreen);
  EXPECT_FALSE(session.on_frame(moving(0), live()).finished);
}

TEST_F(CartoonSessionTest, AcceptsAChangeOfImageSize) {
  CartoonSession session(cartoonizer_, options_);
  session.on_frame(moving(0), live());
  Frame frame = moving(1);
  frame.image = frame.image(cv::Rect(0, 0, 99, 67)).clone();
  EXPECT_EQ(session.on_frame(frame, live()).output.size(), cv::Size(99, 67));
}

TEST_F(CartoonSessionTest, RefusesUnsuitableImages) {
  CartoonSession session(cartoonizer_, options_);
  Frame frame = still("tiny.png");
  frame.image = frame.image(cv::Rect(0, 0, 8, 8)).clone();
  EXPECT_THROW(session.on_frame(frame, {}), InputError);
  EXPECT_NO_THROW(session.on_event(key_event('s'))) << "and goes on";
  frame.image = cv::Mat(50, 50, CV_8UC1, cv::Scalar(0));
  EXPECT_THROW(session.on_frame(frame, {}), std::invalid_argument);
  options_.save_folder.clear();
  EXPECT_THROW((CartoonSession{cartoonizer_, options_}), std::invalid_argument);
}

TEST_F(CartoonSessionTest, WithoutStatusDrawsNoBarAndNoBanner) {
  CartoonSession session(cartoonizer_, options_);
  session.draw_status(false);
  SourceStatus stale = live(4);
  stale.state = SourceState::kStale;
  const View view = session.on_frame(moving(0), stale);
  EXPECT_EQ(max_difference(view.image, view.output), 0);
  test_support::expect_plain_image(session, stale);
  // Paused, the image is the newest drawing.
  session.on_event(key_event(key::kSpace));
  const cv::Mat cartoon = session.on_idle(stale).image.clone();
  const View sketch = session.on_event(key_event('s'));
  EXPECT_TRUE(sketch.output.empty());
  EXPECT_GT(max_difference(sketch.image, cartoon), 50);
}

}  // namespace
}  // namespace tarsier
