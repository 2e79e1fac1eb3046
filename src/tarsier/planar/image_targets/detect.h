// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/planar_pose.h"
#include "tarsier/planar/image_targets/align.h"
#include "tarsier/planar/image_targets/match.h"
#include "tarsier/planar/image_targets/target.h"

#include <array>
#include <optional>
#include <vector>

namespace tarsier::planar::image_targets {

struct DetectOptions {
  FeatureOptions features{.max_features = 900, .contrast = 4, .second_directions = true};
  MatchOptions match;
  int max_hypotheses = 6;         // hypotheses that are aligned before a target counts as absent
  double min_side_px = 24;        // minimum size in the frame: square root of the area
  double min_inlier_share = 0.3;  // minimum share of inliers among the visible patches
  int min_inlier_patches = 10;    // minimum number of inlier patches
  double min_coverage = 0.1;      // minimum share of the image that the inlier patches cover
  // Maximum deviation of the least certain corner, relative to the target's side.
  double max_deviation = 0.03;

  [[nodiscard]] OptionFields fields() {
    return {{"tries", max_hypotheses, range(1, 50)},
            {"min_side_px", min_side_px, range(8, 10000)},
            {"good_part", min_inlier_share, range(0, 1)},
            {"good_patches", min_inlier_patches, range(4, 100)},
            {"min_covered", min_coverage, range(0, 1)},
            {"max_deviation", max_deviation, above(0)}};
  }
  void check() const;
};

struct DetectedTarget {
  std::size_t target = 0;                       // index
  cv::Matx33d homography;                       // from px of the target's image to px of the frame
  std::array<cv::Point2d, 4> corners;           // px, top left of the print first, clockwise
  std::vector<Correspondence> correspondences;  // observations used for the homography
  double rms_px = 0;                            // rms of the sightings
  double confidence = 0;                        // 0..1: share of inliers among the visible patches
  // Only with a camera. From the print's plane (x right, y up, z out of the sheet) to the camera,
  // metres.
  std::optional<geometry::PlanarPoses> poses;
};

// Detects each target independently, at most once, in `frame` (CV_8UC1 or CV_8UC3). With a camera
// it also estimates the poses; if the camera has a size, this must be the frame's size. `debug`
// receives the features and, for each target, its matches and inliers.
[[nodiscard]] std::vector<DetectedTarget> detect_targets(const std::vector<Target>& targets,
                                                         const cv::Mat& frame,
                                                         const DetectOptions& options = {},
                                                         const geometry::Camera* camera = nullptr,
                                                         DebugSink* debug = nullptr);

// The same for one target, with given features and pyramid of the frame.
[[nodiscard]] std::optional<DetectedTarget> detect_target(const Target& target,
                                                          const FeatureSet& features,
                                                          const Pyramid& pyramid, cv::Size frame,
                                                          const DetectOptions& options,
                                                          DebugSink* debug = nullptr);

// Draws the features of a frame (CV_8UC1) as circles proportional to their scale.
void show_features(DebugSink& debug, const cv::Mat& gray, const FeatureSet& features);

// Whether enough patches are inliers to accept the target.
[[nodiscard]] bool is_convincing(const Alignment& alignment, const DetectOptions& options);

// Estimates the poses from the sightings. Homography and corners are replaced by those of the
// better pose if it fits the sightings nearly as well.
void find_poses(DetectedTarget& found, const Target& target, const geometry::Camera& camera);

}  // namespace tarsier::planar::image_targets
