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
  FeatureOptions features{.most = 900, .contrast = 4, .second_directions = true};
  MatchOptions match;
  int tries = 6;                // guesses that are aligned before a target counts as absent
  double min_side_px = 24;      // of the target in the frame: root of its area
  double good_part = 0.3;       // of the visible patches that must fit
  int good_patches = 10;        // at least
  double min_covered = 0.1;     // of the image, by the patches that fit
  double max_deviation = 0.03;  // of the least certain corner, as a part of the target's side

  [[nodiscard]] OptionFields fields() {
    return {{"tries", tries, range(1, 50)},
            {"min_side_px", min_side_px, range(8, 10000)},
            {"good_part", good_part, range(0, 1)},
            {"good_patches", good_patches, range(4, 100)},
            {"min_covered", min_covered, range(0, 1)},
            {"max_deviation", max_deviation, above(0)}};
  }
  void check() const;
};

struct FoundTarget {
  std::size_t target = 0;                      // index
  cv::Matx33d homography;                      // px of the frame from px of the target's image
  std::array<cv::Point2d, 4> corners;          // px, top left of the print first, clockwise
  std::vector<Sighting> sightings;             // that it follows from
  double rms_px = 0;                           // of these
  double confidence = 0;                       // 0..1: part of the visible patches that fit
  std::optional<geometry::PlanarPoses> poses;  // with a camera: camera from the print's plane (x
                                               // right, y up, z out of the sheet), metres
};

// Looks for each target once in `frame` (CV_8UC1 or CV_8UC3), all of one image, on its own. With
// a camera also the poses; its size must be the frame's where it is known. `debug` gets the
// features and, of each target, what matches it beside what fits it.
[[nodiscard]] std::vector<FoundTarget> detect_targets(const std::vector<Target>& targets,
                                                      const cv::Mat& frame,
                                                      const DetectOptions& options = {},
                                                      const geometry::Camera* camera = nullptr,
                                                      DebugSink* debug = nullptr);

// The same on the parts: features and pyramid of the frame at hand.
[[nodiscard]] std::optional<FoundTarget> detect_target(const Target& target,
                                                       const FeatureSet& features,
                                                       const Pyramid& pyramid, cv::Size frame,
                                                       const DetectOptions& options,
                                                       DebugSink* debug = nullptr);

// The features of a frame (CV_8UC1) drawn on it, as circles that grow with their scale.
void show_features(DebugSink& debug, const cv::Mat& gray, const FeatureSet& features);

// Whether enough of the patches fit to believe it.
[[nodiscard]] bool is_convincing(const Alignment& alignment, const DetectOptions& options);

// Poses from the sightings; the homography and corners become those of the better pose where it
// explains the sightings nearly as well.
void find_poses(FoundTarget& found, const Target& target, const geometry::Camera& camera);

}  // namespace tarsier::planar::image_targets
