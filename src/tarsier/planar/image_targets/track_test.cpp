// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/track.h"

#include "tarsier/planar/image_targets/testing_corners.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/planar_worlds.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::planar::image_targets {
namespace {

constexpr double kStep = 1 / 25.0;  // s

Target trained(int id) {
  TrainOptions options;
  options.trials = 6;
  return train_target(synth::poster_print(id, 5).image, "poster", options);
}

const std::vector<Target>& two_posters() {
  static const std::vector<Target> targets = {trained(0), trained(1)};
  return targets;
}

synth::PlanarVideo video(int prints, double speed) {
  synth::VideoOptions options;
  options.speed_px = speed;
  options.exposure = 0.35;
  options.imaging.noise = 3;
  std::vector<synth::PlanarPrint> list;
  for (int i = 0; i < prints; ++i) {
    list.push_back(synth::poster_print(i, 5));
    list.back().id = i;
  }
  return synth::print_video(std::move(list), options);
}

TEST(TargetTracking, TracksMovingCameraWithoutDrift) {
  const synth::PlanarVideo f = video(1, 25);
  TrackState state;
  const std::vector<Target> targets = {two_posters()[0]};
  int frames = 0;
  int good = 0;
  int detections = 0;
  double late = 0;
  for (int i = 0; i < 60; ++i) {
    const double t = i * kStep;
    const auto truth = f.truth_at(t);
    const auto seen = track(targets, {}, state, f.image_at(t), &f.camera());
    if (truth.empty() || truth[0].visible < 0.4) continue;
    ++frames;
    if (seen.empty()) continue;
    const double error = corner_rms(seen[0].corners, truth[0].corners);
    if (error < 2) ++good;
    if (seen[0].detected) ++detections;
    if (i >= 50) late = std::max(late, error);
    ASSERT_TRUE(seen[0].pose.has_value());
    EXPECT_LT(geometry::angle_of(seen[0].pose->camera_from_plane.rotation *
                                 truth[0].camera_from_print.rotation.transpose()),
              0.06)
        << i;
  }
  EXPECT_GE(good, frames * 98 / 100);
  EXPECT_LE(detections, 2);
  EXPECT_LT(late, 1);
}

TEST(TargetTracking, TracksSeveralTargets) {
  const synth::PlanarVideo f = video(2, 12);
  TrackState state;
  int pairs = 0;
  for (int i = 0; i < 15; ++i) {
    const double t = i * kStep;
    const auto truth = f.truth_at(t);
    const auto seen = track(two_posters(), {}, state, f.image_at(t));
    if (truth.size() != 2 || truth[0].visible < 0.5 || truth[1].visible < 0.5) continue;
    if (seen.size() != 2) continue;
    ++pairs;
    for (const TrackedTarget& s : seen)
      EXPECT_LT(corner_rms(s.corners, truth[s.target].corners), 2) << i;
  }
  EXPECT_GE(pairs, 10);
}

TEST(TargetTracking, RedetectsAfterLoss) {
  const synth::PlanarVideo f = video(1, 20);
  const std::vector<Target> targets = {two_posters()[0]};
  TrackState state;
  EXPECT_FALSE(track(targets, {}, state, f.image_at(0)).empty());
  const cv::Mat dark(480, 640, CV_8UC3, cv::Scalar::all(20));
  EXPECT_TRUE(track(targets, {}, state, dark).empty());
  EXPECT_TRUE(track(targets, {}, state, dark).empty());
  // At another position than where it was lost.
  const auto again = track(targets, {}, state, f.image_at(1));
  ASSERT_EQ(again.size(), 1U);
  EXPECT_TRUE(again[0].detected);
  EXPECT_EQ(again[0].frames, 1);
  EXPECT_LT(corner_rms(again[0].corners, f.truth_at(1)[0].corners), 1);
}

TEST(TargetTracking, IsSteadyAtRest) {
  const synth::PlanarVideo f = video(1, 25);
  const std::vector<Target> targets = {two_posters()[0]};
  // The same view many times with new noise, as of a camera on a tripod.
  const cv::Mat clean = f.image_at(0);
  const auto tremble = [&](double steady_px) {
    TrackOptions options;
    options.steady_px = steady_px;
    TrackState state;
    cv::RNG noise(7);
    double sum = 0;
    int n = 0;
    cv::Point2d last;
    for (int i = 0; i < 25; ++i) {
      cv::Mat grain(clean.size(), CV_16SC3);
      noise.fill(grain, cv::RNG::NORMAL, 0, 4);
      cv::Mat wide;
      clean.convertTo(wide, CV_16S);
      wide += grain;
      cv::Mat image;
      wide.convertTo(image, CV_8U);
      const auto seen = track(targets, options, state, image);
      if (seen.empty()) continue;
      if (i > 5) {
        sum += cv::norm(seen[0].corners[0] - last);
        ++n;
      }
      last = seen[0].corners[0];
    }
    EXPECT_GE(n, 19);
    return sum / std::max(n, 1);
  };
  const double raw = tremble(0);
  const double smooth = tremble(TrackOptions{}.steady_px);
  EXPECT_LT(raw, 0.15);
  EXPECT_LT(smooth, 0.3 * raw);
}

TEST(TargetTracking, RestartsForAnotherFrameSize) {
  const synth::PlanarVideo f = video(1, 25);
  const std::vector<Target> targets = {two_posters()[0]};
  TrackState state;
  const cv::Mat image = f.image_at(0);
  EXPECT_FALSE(track(targets, {}, state, image).empty());
  const auto seen = track(targets, {}, state, image(cv::Rect(0, 0, 630, 480)).clone());
  ASSERT_EQ(seen.size(), 1U);
  EXPECT_TRUE(seen[0].detected);
}

}  // namespace
}  // namespace tarsier::planar::image_targets
