// SPDX-License-Identifier: MIT
#include "ui/scripted_host.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier {
namespace {

// Five frames, each filled with its number; a gap of silence before the fourth.
class CountingSource final : public FrameSource {
 public:
  explicit CountingSource(bool gap = false) : gap_(gap) {}
  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token& stop) override {
    if (stop.stop_requested() || ended()) return std::nullopt;
    if (gap_ && position_ == 3) {
      gap_ = false;
      return std::nullopt;
    }
    Frame frame;
    frame.image = cv::Mat(4, 4, CV_8UC3, cv::Scalar::all(static_cast<double>(position_)));
    frame.index = position_++;
    frame.name = "counting";
    return frame;
  }
  [[nodiscard]] bool ended() const override { return position_ == 5; }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override { return {}; }
  [[nodiscard]] double fps() const override { return 0; }
  [[nodiscard]] std::int64_t count() const override { return 5; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  std::int64_t position_ = 0;
  bool gap_;
  std::vector<std::string> skipped_;
};

// Adds what sliders say to the image; one buffer for all views, as sessions may.
class AddingSession final : public Session {
 public:
  View on_frame(const Frame& frame, const SourceStatus&) override {
    buffer_.create(frame.image.size(), CV_8UC3);
    buffer_ = frame.image + cv::Scalar::all(offset_);
    View view = show();
    view.output = buffer_;
    return view;
  }
  View on_idle(const SourceStatus&) override {
    View view = show();
    view.status = "waiting";
    return view;
  }
  View on_event(const Event& event) override {
    if (event.kind == Event::Kind::kSlider) offset_ = event.value;
    View view = show();
    view.finished = event.kind == Event::Kind::kKey && event.key == 'q';
    view.toggle_fullscreen = event.kind == Event::Kind::kKey && event.key == 'f';
    return view;
  }
  [[nodiscard]] std::vector<Action> actions() const override { return {}; }
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

 private:
  View show() {
    View view;
    view.image = buffer_;
    view.status = "ok";
    view.state = {{"offset", offset_}};
    return view;
  }
  cv::Mat buffer_;
  double offset_ = 0;
};

class CollectingSink final : public FrameSink {
 public:
  std::string write(const cv::Mat& image, const Frame& source) override {
    values.push_back(image.at<cv::Vec3b>(0, 0)[0]);
    return std::to_string(source.index);
  }
  void finish() override {}
  [[nodiscard]] std::string description() const override { return "test"; }
  std::vector<int> values;
};

std::vector<std::string> causes(const std::vector<ScriptStep>& steps) {
  std::vector<std::string> result;
  for (const ScriptStep& step : steps) result.push_back(step.cause);
  return result;
}

using Texts = std::vector<std::string>;

TEST(ScriptedHost, SendsEventsBeforeTheirFrames) {
  AddingSession session;
  CountingSource source;
  CollectingSink sink;
  ScriptedHost host(session, source);
  host.schedule(2, slider_event("offset", 10));
  host.schedule(2, key_event('x'));
  host.schedule(99, action_event("late"));
  host.keep_images(1);
  host.keep_images(4);
  host.write_to(&sink);
  const std::vector<ScriptStep>& steps = host.run();
  EXPECT_EQ(causes(steps), (Texts{"frame", "frame", "slider offset 10", "key x", "frame", "frame",
                                  "frame", "action late"}));
  EXPECT_EQ(sink.values, (std::vector<int>{0, 1, 12, 13, 14}));
  EXPECT_EQ(steps[2].frame, 1);
  EXPECT_EQ(steps[4].frame, 2);
  EXPECT_EQ(steps[4].written, "2");
  EXPECT_EQ(steps[4].state["offset"], 10);
  EXPECT_TRUE(steps[0].image.empty());
  ASSERT_FALSE(steps[1].image.empty());
  EXPECT_EQ(steps[1].image.at<cv::Vec3b>(0, 0)[0], 1) << "a copy: later frames do not change it";
  EXPECT_EQ(steps[6].output.at<cv::Vec3b>(0, 0)[0], 14);
}

TEST(ScriptedHost, EndsWhenTheSessionHasFinished) {
  AddingSession session;
  CountingSource source;
  ScriptedHost host(session, source);
  host.schedule(0, key_event('f'));
  host.schedule(3, key_event('q'));
  EXPECT_EQ(causes(host.run()), (Texts{"key f", "frame", "frame", "frame", "key q"}));
  EXPECT_TRUE(host.steps().front().toggle_fullscreen);
  EXPECT_TRUE(host.steps().back().finished);
}

TEST(ScriptedHost, SilentSourceGivesIdleSteps) {
  AddingSession session;
  CountingSource source(true);
  ScriptedHost host(session, source);
  EXPECT_EQ(causes(host.run()), (Texts{"frame", "frame", "frame", "idle", "frame", "frame"}));
  EXPECT_EQ(host.steps()[3].status, "waiting");
}

TEST(ScriptedHost, RunInPartsGivesTheSameTranscript) {
  std::string whole;
  for (const int part : {0, 1, 2}) {
    AddingSession session;
    CountingSource source;
    ScriptedHost host(session, source);
    host.schedule(1, slider_event("offset", 2.5));
    do {
      (void)host.run(part);
    } while (!source.ended());
    if (whole.empty()) whole = host.transcript();
    EXPECT_EQ(host.transcript(), whole);
  }
  EXPECT_THAT(
      whole,
      testing::HasSubstr(
          R"({"cause":"slider offset 2.5","frame":0,"state":{"offset":2.5},"status":"ok"})"));
}

TEST(ScriptedHost, StopsWhenRequested) {
  AddingSession session;
  CountingSource source;
  ScriptedHost host(session, source);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_TRUE(host.run(0, stop.get_token()).empty());
  EXPECT_THROW(host.schedule(-1, key_event('x')), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier
