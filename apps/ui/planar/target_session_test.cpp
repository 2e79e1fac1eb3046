// SPDX-License-Identifier: MIT
#include "ui/planar/target_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/synth/planar_images.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/planar_worlds.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier {
namespace {

synth::PlanarVideo video() { return synth::print_video({synth::poster_print(0, 5)}, {}); }

Frame frame_of(const cv::Mat& image, bool still) {
  Frame frame;
  frame.image = image;
  frame.name = "video";
  frame.still = still;
  return frame;
}

planar::image_targets::Target trained(int trials = 4) {
  planar::image_targets::TrainOptions options;
  options.trials = trials;
  return planar::image_targets::train_target(synth::poster_print(0, 5).image, "poster", options);
}

const SourceStatus kLive = {.state = SourceState::kLive, .detail = "", .age_s = 0};

double distance(const nlohmann::ordered_json& corner, const cv::Point2d& truth) {
  return std::hypot(corner[0].get<double>() - truth.x, corner[1].get<double>() - truth.y);
}

TEST(TargetSession, ReportsTheTargetPositionAndDraws) {
  const auto f = video();
  planar::TargetTrackerOptions options;
  options.camera = f.camera();
  TargetSession session(planar::TargetTracker({trained()}, options));
  const cv::Mat image = f.image_at(0);
  const View view = session.on_frame(frame_of(image, false), kLive);
  const auto truth = f.truth_at(0);
  const auto markers = to_json(session.result()).at("markers");
  ASSERT_EQ(markers.size(), 1U);
  EXPECT_EQ(markers[0]["id"], 0);
  EXPECT_EQ(markers[0]["name"], "poster");
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_LT(distance(markers[0]["corners"][i], truth[0].corners[i]), 1);
  EXPECT_EQ(markers[0]["tvec"].size(), 3U);
  // The homography is that of the image as it was given, 600 x 450 px.
  const auto& h = markers[0]["homography"];
  const auto at = [&](double x, double y) {
    const double w = h[6].get<double>() * x + h[7].get<double>() * y + h[8].get<double>();
    return cv::Point2d((h[0].get<double>() * x + h[1].get<double>() * y + h[2].get<double>()) / w,
                       (h[3].get<double>() * x + h[4].get<double>() * y + h[5].get<double>()) / w);
  };
  EXPECT_LT(cv::norm(at(599.5, 449.5) - truth[0].corners[2]), 1);
  EXPECT_NE(cv::norm(view.output, image), 0);
  EXPECT_EQ(view.state["targets"].size(), 1U);
}

TEST(TargetSession, TrainsTheRectangleDrawnByTheMouse) {
  // A print that fills the middle of the image, seen squarely.
  cv::Mat scene(480, 640, CV_8UC3, cv::Scalar(120, 130, 140));
  const cv::Mat poster = synth::poster_image({320, 240}, 3);
  poster.copyTo(scene(cv::Rect(160, 120, 320, 240)));
  TargetSessionOptions options;
  options.train.trials = 4;
  TargetSession session(planar::TargetTracker({}), options);
  EXPECT_TRUE(session.on_frame(frame_of(scene, false), kLive).state["targets"].empty());
  const auto mouse = [&](Event::Mouse kind, double x, double y) {
    Event event;
    event.kind = Event::Kind::kMouse;
    event.mouse = kind;
    event.x = x;
    event.y = y;
    return session.on_event(event);
  };
  static_cast<void>(mouse(Event::Mouse::kLeftDown, 160, 120));
  static_cast<void>(mouse(Event::Mouse::kMove, 300, 200));
  const View done = mouse(Event::Mouse::kLeftUp, 480, 360);
  EXPECT_EQ(done.state["trained"], 1);
  // It moves: it is followed.
  cv::Mat moved(480, 640, CV_8UC3, cv::Scalar(120, 130, 140));
  poster.copyTo(moved(cv::Rect(180, 110, 320, 240)));
  const View view = session.on_frame(frame_of(moved, false), kLive);
  ASSERT_EQ(view.state["targets"].size(), 1U);
  EXPECT_NEAR(view.state["targets"][0]["corners"][0][0].get<double>(), 179.5, 1);
  EXPECT_NEAR(view.state["targets"][0]["corners"][0][1].get<double>(), 109.5, 1);
  EXPECT_EQ(session.on_event(action_event("forget")).state["trained"], 0);
  EXPECT_TRUE(session.on_frame(frame_of(moved, false), kLive).state["targets"].empty());
}

TEST(TargetSession, RefusesToTrainAnImageWithoutTexture) {
  TargetSessionOptions options;
  options.train.trials = 2;
  TargetSession session(planar::TargetTracker({}), options);
  EXPECT_EQ(session.on_event(key_event('t')).state["trained"], 0);  // no frame yet
  const cv::Mat flat(480, 640, CV_8UC3, cv::Scalar::all(100));
  static_cast<void>(session.on_frame(frame_of(flat, false), kLive));
  const View refused = session.on_event(key_event('t'));
  EXPECT_EQ(refused.state["trained"], 0);
  EXPECT_NE(refused.state["message"].get<std::string>().find("not trained"), std::string::npos);
}

TEST(TargetSession, RefusesACameraOfAnotherAspectRatio) {
  const auto f = video();
  planar::TargetTrackerOptions options;
  options.camera = f.camera();
  TargetSession session(planar::TargetTracker({trained(2)}, options));
  EXPECT_THROW(
      (void)session.on_frame(frame_of(cv::Mat(480, 480, CV_8UC3, cv::Scalar::all(9)), true), kLive),
      InputError);
}

// What is drawn otherwise on a still is what goes to the sink, that of a video is written once.
TEST(TargetSession, KeyUpdatesTheOutputOfStillsOnly) {
  const auto f = video();
  planar::TargetTrackerOptions options;
  options.camera = f.camera();
  for (const bool still : {true, false}) {
    TargetSession session(planar::TargetTracker({trained(2)}, options));
    const cv::Mat box = session.on_frame(frame_of(f.image_at(0), still), kLive).output.clone();
    ASSERT_EQ(session.result().tracked.size(), 1U);
    const View none = session.on_event(key_event('v'));
    ASSERT_EQ(none.output.empty(), !still);
    if (still) {
      EXPECT_EQ(cv::norm(none.output, f.image_at(0), cv::NORM_INF), 0);
      EXPECT_GT(cv::norm(none.output, box, cv::NORM_INF), 60);
    }
    EXPECT_TRUE(session.on_event(key_event('d')).output.empty()) << "found in the next frame";
  }
}

TEST(TargetSession, KeysChangeOverlayPauseAndQuit) {
  TargetSession session(planar::TargetTracker({}));
  static_cast<void>(
      session.on_frame(frame_of(cv::Mat(120, 160, CV_8UC3, cv::Scalar::all(9)), true), kLive));
  EXPECT_EQ(session.on_event(key_event('v')).state["draw"], "none");
  EXPECT_EQ(session.on_event(key_event('v')).state["draw"], "outline");
  EXPECT_EQ(session.on_event(key_event(key::kSpace)).state["paused"], true);
  EXPECT_FALSE(session.on_event(key_event('h')).finished);
  EXPECT_TRUE(session.on_event(key_event('q')).finished);
}

}  // namespace
}  // namespace tarsier
