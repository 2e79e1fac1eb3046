// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/pose.h"

#include "tarsier/planar/markers/detector.h"
#include "tarsier/planar/markers/testing_pose.h"
#include "tarsier/synth/planar_worlds.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

namespace tarsier::planar::markers {
namespace {

TEST(MarkerPose, FrameIsUprightAndOutOfTheSheet) {
  // Frontal view: the camera's y axis points down, the marker's y axis up, and its z axis to the
  // camera.
  const Quad quad{Eigen::Vector2d(289.5, 209.5), Eigen::Vector2d(349.5, 209.5),
                  Eigen::Vector2d(349.5, 269.5), Eigen::Vector2d(289.5, 269.5)};
  Marker marker;
  marker.corners = quad;
  const auto pose = pose_of_marker(marker, 0.05, test_camera());
  ASSERT_TRUE(pose);
  const geometry::Rigid3 truth{kFacing, {0, 0, 0.5}};
  EXPECT_LT(degrees_between(pose->camera_from_marker, truth), 1e-3);
  EXPECT_LT((pose->camera_from_marker.translation - truth.translation).norm(), 1e-9);
  EXPECT_THROW((void)pose_of_marker(marker, 0, test_camera()), std::invalid_argument);
}

TEST(PoseTracks, DistinguishTwoMarkersOfOneId) {
  const geometry::Camera camera = test_camera();
  PoseTracks tracks;
  for (int i = 0; i < 10; ++i) {
    const geometry::Rigid3 left{kFacing, {-0.1 + 0.002 * i, 0, 0.5}};
    const geometry::Rigid3 right{kFacing, {0.1 - 0.002 * i, 0, 0.5}};
    Marker a;
    a.id = 3;
    a.corners = seen(left, 0.05, camera);
    Marker b = a;
    b.corners = seen(right, 0.05, camera);
    if (i % 2 == 1) std::swap(a, b);  // found in any order
    const auto posed = track_markers({a, b}, 0.05, camera, 0.04 * i, {}, tracks);
    ASSERT_EQ(posed.size(), 2U);
    for (const PosedMarker& marker : posed) {
      const bool is_left = marker.marker.corners[0].x() < 319;
      EXPECT_LT((marker.pose->camera_from_marker.translation - (is_left ? left : right).translation)
                    .norm(),
                0.002)
          << i;
    }
  }
}

// A whole video: detection, poses, filtering.
TEST(PoseTracks, HaveFewFlipsAndAreSteadyAtRest) {
  const Dictionary& family = find_dictionary("36h11");
  synth::VideoOptions options;
  options.shutter = 0;
  options.with_occluder = false;
  options.seed = 4;
  options.speed_px = 15;
  const synth::PlanarVideo video = synth::marker_video(family, 4, 0.05, options);
  PoseTracks tracks;
  DetectWorkspace workspace;
  int seen_markers = 0;
  int flips = 0;
  std::map<int, geometry::Rigid3> last;
  double max_step = 0;
  for (int i = 0; i < 75; ++i) {
    const double time = i / 12.5;
    cv::Mat gray;
    cv::cvtColor(video.image_at(time), gray, cv::COLOR_BGR2GRAY);
    const auto posed = track_markers(detect_markers(gray, family, {}, workspace), 0.05,
                                     video.camera(), time, {}, tracks);
    for (const synth::PrintTruth& truth : video.truth_at(time)) {
      const auto found = std::find_if(posed.begin(), posed.end(), [&](const PosedMarker& m) {
        return m.marker.id == truth.id;
      });
      if (found == posed.end() || !found->pose) continue;
      ++seen_markers;
      const geometry::Rigid3& pose = found->pose->camera_from_marker;
      if (degrees_between(pose, truth.camera_from_print) > 15) ++flips;
      if (synth::PlanarVideo::is_at_rest(time) && synth::PlanarVideo::is_at_rest(time - 0.5) &&
          last.contains(truth.id))
        max_step = std::max(max_step, degrees_between(pose, last[truth.id]));
      last[truth.id] = pose;
    }
  }
  EXPECT_GT(seen_markers, 225);
  EXPECT_LE(flips, seen_markers / 200);
  EXPECT_LT(max_step, 1.0);
}

}  // namespace
}  // namespace tarsier::planar::markers
