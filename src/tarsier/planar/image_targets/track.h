// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/planar_pose.h"
#include "tarsier/planar/image_targets/detect.h"

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

// Tracking of targets in a video. For a target of the last frame, the motion predicts its position;
// a coarse search finds its shift, and then patches of the trained image itself are aligned, so
// that nothing drifts. A target that is lost or was never found is searched in the whole frame.
namespace tarsier::planar::image_targets {

struct TrackOptions {
  DetectOptions detect;
  AlignOptions align;
  double search_px = 40;  // maximum distance of a target from its predicted position, px
  double min_inlier_share =
      0.2;  // minimum share of inliers among the visible patches of a tracked target
  int min_inlier_patches = 8;  // minimum number of inlier patches
  int detect_every = 8;    // frames between searches for missing targets while others are tracked
  double steady_px = 0.4;  // px; smaller motion is smoothed over time; 0 disables it

  [[nodiscard]] OptionFields fields() {
    return {{"steady_px", steady_px, range(0, 5), "--smooth",
             "motion below about this is smoothed over time, px; 0: none"},
            {"detect_every", detect_every, range(1, 1000), "--search-every",
             "frames between searches for lost targets while others are tracked"},
            {"search_px", search_px, range(0, 400), "--search-px",
             "px, search radius around the predicted position of a target"},
            {"good_part", min_inlier_share, range(0, 1)},
            {"good_patches", min_inlier_patches, range(4, 100)}};
  }
  void check() const;
};

struct TrackedTarget {
  std::size_t target = 0;              // index
  cv::Matx33d homography;              // from px of the target's image to px of the frame
  std::array<cv::Point2d, 4> corners;  // px, top left of the print first, clockwise
  double rms_px = 0;                   // of the inlier patches
  double confidence = 0;               // 0..1: share of inliers among the visible patches
  bool detected = false;               // detected in this frame, not tracked from the last one
  std::int64_t frames = 0;             // number of frames tracked so far, including this one
  std::optional<geometry::PlanarPose> pose;  // with a camera: see DetectedTarget
};

// The state of one video. Starts empty. It holds for one list of targets and one frame size;
// another size restarts it.
struct TrackState {
  struct TargetTrack {
    bool is_tracked = false;
    std::array<cv::Point2d, 4> corners;   // as measured in the last frame
    std::array<cv::Point2d, 4> velocity;  // px per frame
    std::array<cv::Point2d, 4> steady;    // smoothed
    std::optional<geometry::Rigid3> pose;
    std::int64_t frames = 0;
  };
  std::vector<TargetTrack> targets;
  std::int64_t frame = 0;
  cv::Size size;
};

// Finds the targets in the next frame (CV_8UC1 or CV_8UC3) of a video, in their order. `debug`
// receives the stages of the targets that are detected again (see detect_targets).
[[nodiscard]] std::vector<TrackedTarget> track(const std::vector<Target>& targets,
                                               const TrackOptions& options, TrackState& state,
                                               const cv::Mat& frame,
                                               const geometry::Camera* camera = nullptr,
                                               DebugSink* debug = nullptr);

}  // namespace tarsier::planar::image_targets
