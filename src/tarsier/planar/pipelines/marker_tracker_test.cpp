// SPDX-License-Identifier: MIT
#include "tarsier/planar/pipelines/marker_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/planar/markers/predefined.h"
#include "tarsier/planar/markers/testing_marker.h"
#include "tarsier/planar/pipelines/testing_frame.h"
#include "tarsier/synth/planar_worlds.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace tarsier::planar {
namespace {

constexpr double kSide = 0.05;

synth::PlanarVideo desk_video(const std::string& family = "36h11") {
  synth::VideoOptions options;
  options.size = {480, 360};
  options.speed_px = 8;
  options.shutter = 0;
  options.with_occluder = false;
  return synth::marker_video(markers::find_dictionary(family), 4, kSide, options);
}

MarkerTrackerOptions options_with_camera() {
  MarkerTrackerOptions options;
  options.side = kSide;
  options.camera = desk_video().camera();
  return options;
}

double away(const TrackedMarker& marker) {
  return marker.pose->camera_from_marker.translation.norm();
}

TEST(MarkerTracker, FindsMarkersAndTheirPoses) {
  const auto tracker = MarkerTracker::load(options_with_camera());
  MarkerState state;
  const auto result = tracker.process(frame_of(desk_video().image_at(1), true), state);
  ASSERT_EQ(result.markers.size(), 4U);
  std::map<int, synth::PrintTruth> truth;
  for (const synth::PrintTruth& print : desk_video().truth_at(1)) truth[print.id] = print;
  for (const TrackedMarker& marker : result.markers) {
    EXPECT_EQ(marker.family, "36h11");
    ASSERT_TRUE(truth.contains(marker.marker.id) && marker.pose);
    const synth::PrintTruth& print = truth[marker.marker.id];
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(marker.marker.corners[k].x(), print.corners[k].x, 0.5);
      EXPECT_NEAR(marker.marker.corners[k].y(), print.corners[k].y, 0.5);
    }
    const double distance = print.camera_from_print.translation.norm();
    EXPECT_NEAR(away(marker), distance, 0.02 * distance);
  }
}

TEST(MarkerTracker, JsonHasDocumentedKeys) {
  const auto tracker = MarkerTracker::load(options_with_camera());
  MarkerState state;
  auto result = tracker.process(frame_of(desk_video().image_at(1), true), state);
  result.ms = 12.3456;
  const auto json = to_json(result);
  std::string keys;
  for (const auto& item : json["markers"][0].items()) keys += item.key() + " ";
  EXPECT_EQ(keys, "id corners rvec tvec errors ambiguity margin ");
  EXPECT_EQ(json["markers"].size(), 4U);
  EXPECT_EQ(json["markers"][0]["corners"].size(), 4U);
  EXPECT_EQ(json["ms"], 12.35);
}

TEST(MarkerTracker, SmoothsVideosAndResetsForAnotherSource) {
  const auto tracker = MarkerTracker::load(options_with_camera());
  MarkerState alone;
  MarkerState state;
  const auto clip = desk_video();
  const auto pose_of = [&](const MarkerResult& result) {
    return result.markers.at(0).pose->camera_from_marker.translation;
  };
  const auto exactly = [&](double time) {
    alone = {};
    return pose_of(tracker.process(frame_of(clip.image_at(time), true), alone));
  };
  for (int i = 0; i < 5; ++i)
    (void)tracker.process(frame_of(clip.image_at(i / 25.0), false, i / 25.0), state);
  const cv::Mat last = clip.image_at(0.2);
  const auto tracked = pose_of(tracker.process(frame_of(last, false, 0.2), state));
  EXPECT_GT((tracked - exactly(0.2)).norm(), 0);  // between this frame and the previous ones
  const auto other = pose_of(tracker.process(frame_of(last, false, 0.2, "other.mp4"), state));
  EXPECT_EQ((other - exactly(0.2)).norm(), 0);
  // Frames of a folder that is played as a desk_video belong to one source.
  for (int i = 0; i < 5; ++i)
    (void)tracker.process(
        frame_of(clip.image_at(i / 25.0), false, i / 25.0, "a/" + std::to_string(i) + ".png"),
        state);
  EXPECT_EQ(pose_of(tracker.process(frame_of(last, false, 0.2, "a/5.png"), state)), tracked);
}

// A board of 2 x 2 markers in the given pose. One marker may be hidden.
cv::Mat board_image(const markers::MarkerBoard& board, const geometry::Rigid3& camera_from_board,
                    const geometry::Camera& camera, int hidden) {
  cv::Mat gray(camera.height, camera.width, CV_8UC1, cv::Scalar(120));
  for (const markers::BoardMarker& place : board.markers) {
    if (place.id == hidden) continue;
    markers::DrawnMarker drawn{place.id, {}};
    const auto corners = markers::corners_on_marker(place.size);
    for (std::size_t k = 0; k < 4; ++k) {
      const cv::Point2d on_board = place.center + corners[k];
      const auto p = camera.project(camera_from_board * Eigen::Vector3d(on_board.x, on_board.y, 0));
      drawn.corners[k] = {p->x, p->y};
    }
    markers::draw_marker(gray, markers::find_dictionary(board.family), drawn);
  }
  return gray;
}

TEST(MarkerTracker, BoardHasAPoseWhileAMarkerIsHidden) {
  MarkerTrackerOptions options;
  options.camera = geometry::guessed_camera({640, 480});
  options.board = markers::MarkerBoard{"36h11", {}};
  for (int id = 0; id < 4; ++id)
    options.board->markers.push_back({id, {0.06 * (id % 2), 0.06 * (id / 2)}, 0, 0.04});
  const auto tracker = MarkerTracker::load(options);
  MarkerState state;
  for (int i = 0; i < 5; ++i) {
    const geometry::Rigid3 truth{geometry::rotation_by({2.6, 0.2, 0.1}),
                                 {-0.03 + 0.002 * i, 0.02, 0.4}};
    const int hidden = i == 3 ? 0 : -1;
    const cv::Mat image = board_image(*options.board, truth, *options.camera, hidden);
    const auto result = tracker.process(frame_of(image, i == 4, 0.04 * i), state);
    EXPECT_EQ(result.board_markers, i == 3 ? 3 : 4);
    ASSERT_TRUE(result.board) << i;
    const geometry::Rigid3& pose = result.board->camera_from_marker;
    EXPECT_LT((pose.translation - truth.translation).norm(), 0.002) << i;
    EXPECT_LT(geometry::angle_of(pose.rotation * truth.rotation.transpose()), 0.02) << i;
    for (const TrackedMarker& marker : result.markers) EXPECT_FALSE(marker.pose);
    const auto json = to_json(result);
    EXPECT_EQ(json["board"]["markers"], result.board_markers);
    EXPECT_EQ(json["board"]["tvec"].size(), 3U);
  }
  const cv::Mat empty(480, 640, CV_8UC3, cv::Scalar::all(90));
  EXPECT_FALSE(to_json(tracker.process(frame_of(empty, true), state)).contains("board"));
  options.families = {"25h9"};
  EXPECT_THROW((void)MarkerTracker::load(options), std::invalid_argument);
}

TEST(MarkerTracker, SearchesSeveralFamiliesAndNamesThem) {
  const cv::Mat tags = desk_video().image_at(1);
  const cv::Mat codes = desk_video("6x6_250").image_at(1);
  cv::Mat both;
  cv::hconcat(tags, codes, both);
  MarkerTrackerOptions options;
  options.families = {"36h11", "6x6_250"};
  options.side = kSide;
  const auto tracker = MarkerTracker::load(options);
  MarkerState state;
  const auto result = tracker.process(frame_of(both, false), state);
  std::map<std::string, int> counts;
  for (const TrackedMarker& marker : result.markers) {
    ++counts[marker.family];
    const bool is_left = marker.marker.corners[0].x() < tags.cols;
    EXPECT_EQ(marker.family, is_left ? "36h11" : "6x6_250");
  }
  EXPECT_EQ(counts["36h11"], 4);
  EXPECT_EQ(counts["6x6_250"], 4);
  EXPECT_EQ(to_json(result)["markers"][0]["family"], "36h11");
}

TEST(MarkerTracker, HasNoPosesWithoutSide) {
  MarkerTrackerOptions options;
  options.side = 0;
  const auto tracker = MarkerTracker::load(options);
  MarkerState state;
  cv::Mat gray;
  cv::cvtColor(desk_video().image_at(1), gray, cv::COLOR_BGR2GRAY);
  const auto result = tracker.process(frame_of(gray, true), state);
  ASSERT_EQ(result.markers.size(), 4U);
  EXPECT_FALSE(result.markers[0].pose);
  EXPECT_FALSE(to_json(result)["markers"][0].contains("rvec"));
}

TEST(MarkerTracker, OpencvDetectorFindsSameMarkers) {
  MarkerTrackerOptions options = options_with_camera();
  const Frame frame = frame_of(desk_video().image_at(1), true);
  MarkerState state;
  const auto own = MarkerTracker::load(options).process(frame, state);
  options.detector = MarkerDetector::kOpencv;
  const auto opencv = MarkerTracker::load(options).process(frame, state);
  EXPECT_EQ(opencv.markers.size(), own.markers.size());
  for (const TrackedMarker& a : own.markers)
    for (const TrackedMarker& b : opencv.markers)
      if (a.marker.id == b.marker.id) {
        EXPECT_LT((a.marker.corners[0] - b.marker.corners[0]).norm(), 2);
      }
}

TEST(MarkerTracker, ScalesGuessesOrRejectsCamera) {
  MarkerTrackerOptions options = options_with_camera();
  options.camera = geometry::guessed_camera({960, 720});
  const Frame frame = frame_of(desk_video().image_at(1), true);
  MarkerState state;
  EXPECT_NEAR(MarkerTracker::load(options).process(frame, state).camera.fx, 480, 1e-9);
  options.camera = geometry::guessed_camera({1280, 720});
  EXPECT_THROW((void)MarkerTracker::load(options).process(frame, state), InputError);
  options.camera.reset();
  options.focal_px = 700;
  EXPECT_EQ(MarkerTracker::load(options).process(frame, state).camera.fx, 700);
}

TEST(MarkerTracker, RejectsInvalidOptionsAndImages) {
  MarkerTrackerOptions options;
  options.families = {};
  EXPECT_THROW((void)MarkerTracker::load(options), std::invalid_argument);
  options.families = {"9x9"};
  EXPECT_THROW((void)MarkerTracker::load(options), UsageError);
  options = {};
  options.side = -1;
  EXPECT_THROW((void)MarkerTracker::load(options), std::invalid_argument);
  MarkerState state;
  EXPECT_THROW((void)MarkerTracker::load().process(frame_of({}, true), state),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar
