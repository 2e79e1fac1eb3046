// SPDX-License-Identifier: MIT
#include "ui/plate/plate_session.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "ui/testing_source.h"
#include <string>
#include <vector>

namespace tarsier {
namespace {

using test_support::live;

plate::Reading reading_at(cv::Rect box, const std::string& text = "4725BKZ",
                          double confidence = 0.9) {
  plate::Reading reading;
  reading.text = text;
  reading.confidence = confidence;
  reading.plate = 0.95;
  reading.country = "es";
  reading.box = box;
  const cv::Rect2f r(box);
  reading.corners = {cv::Point2f(r.x, r.y), cv::Point2f(r.x + r.width, r.y),
                     cv::Point2f(r.x + r.width, r.y + r.height), cv::Point2f(r.x, r.y + r.height)};
  reading.candidates.push_back({text, confidence, "es"});
  const float step = r.width / static_cast<float>(text.size());
  for (std::size_t k = 0; k < text.size(); ++k) {
    const float left = r.x + step * static_cast<float>(k) + 1;
    reading.characters.push_back(
        {text[k],
         0.95,
         {cv::Point2f(left, r.y + 5), cv::Point2f(left + step - 2, r.y + 5),
          cv::Point2f(left + step - 2, r.y + r.height - 5),
          cv::Point2f(left, r.y + r.height - 5)}});
  }
  return reading;
}

Frame frame_at(int index, bool still = false) {
  Frame frame;
  frame.image = cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(90));
  frame.index = index;
  frame.time = index * 0.1;
  frame.name = "camera";
  frame.still = still;
  return frame;
}

Event pressed(int key) {
  Event event;
  event.kind = Event::Kind::kKey;
  event.key = key;
  return event;
}

class PlateSessionTest : public testing::Test {
 protected:
  std::vector<plate::Reading> seen_;       // what the reader finds in the next frame
  std::vector<plate::PlateEvent> events_;  // that are closed
  std::vector<plate::PlateEvent> all_;
  plate::TrackerOptions options_;
  // A reader that finds what it is given.
  [[nodiscard]] plate::VideoReader reader() {
    return {[this](const Frame&, DebugSink*) { return plate::ReaderResult{seen_, 0}; }, options_};
  }
  PlateSession make() {
    return PlateSession(reader(), [this](const plate::PlateEvent& event) {
      all_.push_back(event);
      if (event.state == plate::PlateState::kClosed) events_.push_back(event);
    });
  }
};

TEST_F(PlateSessionTest, StillHasReadingsButNoEvents) {
  PlateSession session = make();
  seen_ = {reading_at({100, 100, 90, 20})};
  const Frame frame = frame_at(0, true);
  const View view = session.on_frame(frame, live());
  ASSERT_EQ(session.readings().size(), 1U);
  EXPECT_EQ(view.state["plates"], 1);
  EXPECT_GT(cv::norm(view.output, frame.image, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(frame.image, cv::Mat(240, 320, CV_8UC3, cv::Scalar::all(90))), 0)
      << "the frame itself was drawn on";
  session.finish();
  EXPECT_TRUE(events_.empty());
}

TEST_F(PlateSessionTest, VehicleGivesOneClosedEventAtTheEndOfTheVideo) {
  PlateSession session = make();
  for (int k = 0; k < 12; ++k) {
    seen_ = {reading_at({60 + 4 * k, 100, 90, 20})};
    session.on_frame(frame_at(k), live());
  }
  EXPECT_EQ(session.tracks().size(), 1U);
  EXPECT_TRUE(events_.empty());
  session.finish();
  ASSERT_EQ(events_.size(), 1U);
  EXPECT_EQ(events_[0].text, "4725BKZ");
  EXPECT_EQ(events_[0].frames, 12);
  session.finish();
  EXPECT_EQ(events_.size(), 1U);
}

TEST_F(PlateSessionTest, ClosesTheVehiclesOfALostCamera) {
  PlateSession session = make();
  for (int k = 0; k < 12; ++k) {
    seen_ = {reading_at({60 + 4 * k, 100, 90, 20})};
    session.on_frame(frame_at(k), live());
  }
  SourceStatus status = live(500);  // a slow camera
  session.on_idle(status);
  EXPECT_TRUE(events_.empty());
  status.state = SourceState::kLost;
  status.age_s = 1;
  session.on_idle(status);
  EXPECT_TRUE(events_.empty());
  status.age_s = options_.lost_after + options_.return_within + 0.1;
  session.on_idle(status);
  ASSERT_EQ(events_.size(), 1U);
  EXPECT_NEAR(events_[0].last_time, 1.1, 1e-9);
  EXPECT_TRUE(session.tracks().empty());
}

// The same plate before two cameras, one video after the other.
TEST_F(PlateSessionTest, ChangeOfSourceClosesAllVehicles) {
  PlateSession session = make();
  for (int k = 0; k < 24; ++k) {
    seen_ = {reading_at({60 + 4 * k, 100, 90, 20})};
    Frame frame = frame_at(k);
    frame.name = k < 12 ? "first.avi" : "second.avi";
    session.on_frame(frame, live());
    EXPECT_EQ(events_.size(), k < 12 ? 0U : 1U);
  }
  session.finish();
  ASSERT_EQ(events_.size(), 2U);
  EXPECT_EQ(events_[0].source, "first.avi");
  EXPECT_EQ(events_[0].frames, 12);
  EXPECT_NEAR(events_[0].last_time, 1.1, 1e-9);
  EXPECT_EQ(events_[1].source, "second.avi");
  EXPECT_EQ(events_[1].frames, 12);
  for (const plate::PlateEvent& event : all_) {
    EXPECT_EQ(event.source, event.id == events_[0].id ? "first.avi" : "second.avi");
  }
}

TEST_F(PlateSessionTest, ImageSequenceIsOneVideo) {
  PlateSession session = make();
  for (int k = 0; k < 12; ++k) {
    seen_ = {reading_at({60 + 4 * k, 100, 90, 20})};
    Frame frame = frame_at(k);
    frame.name = "street/" + std::to_string(k) + ".png";
    session.on_frame(frame, live());
  }
  session.finish();
  ASSERT_EQ(events_.size(), 1U);
  EXPECT_EQ(events_[0].source, "street");
  EXPECT_EQ(events_[0].frames, 12);
}

TEST_F(PlateSessionTest, EventsHaveTheTimesOfTheirFrames) {
  const plate::Moment noon = plate::parse_moment("2026-05-01T12:00", {}, false, "time");
  PlateSession session(
      reader(), [this](const plate::PlateEvent& event) { all_.push_back(event); },
      [&](const Frame& frame) {
        const std::chrono::milliseconds since(100 * frame.index);
        return plate::FrameMoment{noon + since, since, false};
      });
  for (int k = 0; k < 6; ++k) {
    seen_ = {reading_at({60 + 4 * k, 100, 90, 20})};
    session.on_frame(frame_at(k), live());
  }
  ASSERT_EQ(all_.size(), 1U);
  EXPECT_EQ(all_[0].state, plate::PlateState::kOpened);
  EXPECT_EQ(all_[0].first_seen, noon);
  EXPECT_EQ(all_[0].last_seen, noon + std::chrono::milliseconds(200));
  session.shift_unsynchronized(std::chrono::hours(1));
  session.finish();
  ASSERT_EQ(all_.size(), 2U);
  EXPECT_EQ(all_[1].state, plate::PlateState::kClosed);
  EXPECT_EQ(all_[1].first_seen, noon + std::chrono::hours(1));
}

TEST_F(PlateSessionTest, IgnoresPlatesOutsideTheRegion) {
  options_.region = plate::parse_region("0,0,0.4,1");
  PlateSession session = make();
  seen_ = {reading_at({10, 100, 90, 20}, "1111BBB"), reading_at({220, 100, 90, 20}, "2222CCC")};
  for (int k = 0; k < 5; ++k) session.on_frame(frame_at(k), live());
  ASSERT_EQ(session.readings().size(), 1U);
  EXPECT_EQ(session.readings()[0].text, "1111BBB");
  session.finish();
  ASSERT_EQ(events_.size(), 1U);
  EXPECT_EQ(events_[0].text, "1111BBB");
}

TEST_F(PlateSessionTest, IgnoresWordsUnlessRequested) {
  for (const bool words : {false, true}) {
    options_.words = words;
    events_.clear();
    PlateSession session = make();
    seen_ = {reading_at({60, 100, 90, 20}, "PARKING")};
    for (int k = 0; k < 12; ++k) session.on_frame(frame_at(k), live());
    session.finish();
    EXPECT_EQ(events_.size(), words ? 1U : 0U);
  }
}

TEST_F(PlateSessionTest, KeysToggleCharacterBoxesPauseAndQuit) {
  PlateSession session = make();
  seen_ = {reading_at({100, 60, 160, 60})};
  const View first = session.on_frame(frame_at(0, true), live());
  const cv::Mat with_boxes = first.output.clone();
  const View without = session.on_event(pressed('c'));
  EXPECT_GT(cv::norm(with_boxes, without.output, cv::NORM_INF), 0);
  EXPECT_EQ(session.on_event(pressed(key::kSpace)).state["paused"], true);
  EXPECT_EQ(session.on_event(pressed(key::kSpace)).state["paused"], false);
  EXPECT_FALSE(session.on_event(pressed('x')).finished);
  EXPECT_TRUE(session.on_event(pressed(key::kEscape)).finished);
}

}  // namespace
}  // namespace tarsier
