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

// A target as a part of a JSON line: {"id", "name", "homography" (9 numbers, row by row: from px of
// the original image to px of the frame, H(2,2) = 1), "corners", "confidence"}; with a pose also
// "rvec", "tvec" (metres), "rms_px".
[[nodiscard]] nlohmann::ordered_json target_json(const Target& target, std::size_t id,
                                                 const cv::Matx33d& homography,
                                                 const std::array<cv::Point2d, 4>& corners,
                                                 double confidence,
                                                 const geometry::PlanarPose* pose);

struct PlanarOptions {
  TrainOptions train;  // its width is replaced by that of the truth
  DetectOptions detect;
};

struct PlanarResult {
  std::string image;                  // path as in the truth file
  std::vector<DetectedTarget> found;  // at most one
  nlohmann::ordered_json markers;     // the line's "markers": target_json with id 0
  double ms = 0;                      // without file reading and training
};

// Evaluates a file of truth lines {"image", "target", "K" (9 numbers), "dist" (5, 8 or none),
// "size" (m, the print's width), "markers": ..}; paths are relative to its folder. Each line's
// target is trained once per image and size, and detected alone in the line's image. `each`
// receives the results in the order of the lines. Throws InputError, which names the bad line, and
// Interrupted.
void evaluate_planar(const std::string& truth_path, const PlanarOptions& options,
                     const std::function<void(const PlanarResult&)>& each,
                     const std::stop_token& stop = {});

}  // namespace tarsier::planar::image_targets
