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

// Targets followed through a video. A target that was seen in the last frame is looked for where
// its motion takes it: a coarse search of its shift, then the alignment of patches of the trained
// image itself, so that nothing drifts. One that is lost, or was never seen, is detected.
namespace tarsier::planar::image_targets {

struct TrackOptions {
  DetectOptions detect;
  AlignOptions align;
  double search_px = 40;   // how far from its predicted place a target is searched
  double good_part = 0.2;  // of the visible patches that must fit for it to be still there
  int good_patches = 8;    // at least
  int detect_every = 8;    // frames between looks for the missing while others are followed
  double steady_px = 0.4;  // motion below about this is smoothed over time; 0: nothing is

  [[nodiscard]] OptionFields fields() {
    return {{"steady_px", steady_px, range(0, 5), "--smooth",
             "px: motion below about this is smoothed over time; 0: none"},
            {"detect_every", detect_every, range(1, 1000), "--search-every",
             "frames between searches for targets that are missing while others are followed"},
            {"search_px", search_px, range(0, 400), "--search-px",
             "px, how far from its predicted place a target is searched"},
            {"good_part", good_part, range(0, 1)},
            {"good_patches", good_patches, range(4, 100)}};
  }
  void check() const;
};

struct TrackedTarget {
  std::size_t target = 0;                    // index
  cv::Matx33d homography;                    // px of the frame from px of the target's image
  std::array<cv::Point2d, 4> corners;        // px, top left of the print first, clockwise
  double rms_px = 0;                         // of the patches that fit
  double confidence = 0;                     // 0..1: part of the visible patches that fit
  bool detected = false;                     // again in this frame, not followed from the last
  std::int64_t frames = 0;                   // followed so far, this one included
  std::optional<geometry::PlanarPose> pose;  // with a camera: see FoundTarget
};

// What one video has shown so far. Starts empty; belongs to one list of targets and one size of
// frame (another size starts again).
struct TrackState {
  struct One {
    bool followed = false;
    std::array<cv::Point2d, 4> corners;   // as measured in the last frame
    std::array<cv::Point2d, 4> velocity;  // px a frame
    std::array<cv::Point2d, 4> steady;    // smoothed
    std::optional<geometry::Rigid3> pose;
    std::int64_t frames = 0;
  };
  std::vector<One> targets;
  std::int64_t frame = 0;
  cv::Size size;
};

// The targets in the next frame (CV_8UC1 or CV_8UC3) of a video, in their order. `debug` gets the
// stages of those that are looked for again (see detect_targets).
[[nodiscard]] std::vector<TrackedTarget> track(const std::vector<Target>& targets,
                                               const TrackOptions& options, TrackState& state,
                                               const cv::Mat& frame,
                                               const geometry::Camera* camera = nullptr,
                                               DebugSink* debug = nullptr);

}  // namespace tarsier::planar::image_targets
