// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/detect.h"
#include "tarsier/planar/image_targets/train.h"

#include <functional>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::planar::image_targets {

// A target's part of a JSON line: {"id", "name", "homography" (9 numbers, row by row: px of the
// frame from px of the image as it was given, H(2,2) = 1), "corners", "confidence", and with a
// pose "rvec", "tvec" (metres), "rms_px"}.
[[nodiscard]] nlohmann::ordered_json target_json(const Target& target, std::size_t id,
                                                 const cv::Matx33d& homography,
                                                 const std::array<cv::Point2d, 4>& corners,
                                                 double confidence,
                                                 const geometry::PlanarPose* pose);

struct PlanarOptions {
  TrainOptions train;  // its width is taken from the truth
  DetectOptions detect;
};

struct PlanarResult {
  std::string image;               // as the truth has it
  std::vector<FoundTarget> found;  // at most one
  nlohmann::ordered_json markers;  // the line's "markers": target_json with id 0
  double ms = 0;                   // without reading and training
};

// A file of truth lines {"image", "target", "K" (9 numbers), "dist" (5, 8 or none), "size" (m, the
// print's width), "markers": ..}, paths from its own folder. Each line's target image is trained
// (once for each image and size) and looked for in the line's image, alone. `each` gets the
// results in the lines' order. Throws InputError naming the line for what is no such truth,
// Interrupted.
void evaluate_planar(const std::string& truth_path, const PlanarOptions& options,
                     const std::function<void(const PlanarResult&)>& each,
                     const std::stop_token& stop = {});

}  // namespace tarsier::planar::image_targets
