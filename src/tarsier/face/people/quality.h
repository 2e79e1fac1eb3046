// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/people/eyes.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::face::people {

// Quality of a face for recognition, measured on the crop (crop_face) and its landmarks.
struct Quality {
  double eye_distance = 0;  // px in the image
  // Share of fine detail in the crop's contrast: RMS of the face minus its blur (sigma 1.5 px of
  // 64), divided by the standard deviation. About 0.3 for sharp images, below 0.1 for blurred ones.
  double sharpness = 0;
  // 0: frontal; distance of the nose from the middle, in eye distances.
  double turn = 0;
  // Distance of the nose above (-) or below (+) its usual position, in eye distances.
  double tilt = 0;
  double light = 0;     // median grey, 0..255
  double contrast = 0;  // standard deviation, grey levels
  double clipped = 0;   // share of pixels below 4 or above 251
  double uneven = 0;    // |mean of left - mean of right half| / (their sum), 0..1
  // 0..1: the minimum over all measures; 1 if no measure is near its limit.
  [[nodiscard]] double score() const;
};

struct QualityGate {
  double min_eye_distance = 18;  // px
  double min_sharpness = 0.1;
  double max_turn = 0.35;
  double max_tilt = 0.3;
  double min_light = 30;  // grey
  double max_light = 225;
  double min_contrast = 12;
  double max_clipped = 0.3;
  double max_uneven = 0.6;

  [[nodiscard]] OptionFields fields() {
    return {{"min_eye_distance", min_eye_distance, range(2, 1000)},
            {"min_sharpness", min_sharpness, range(0, 2)},
            {"max_turn", max_turn, range(0, 2)},
            {"max_tilt", max_tilt, range(0, 2)},
            {"min_light", min_light, range(0, 255)},
            {"max_light", max_light, range(0, 255)},
            {"min_contrast", min_contrast, at_least(0)},
            {"max_clipped", max_clipped, range(0, 2)},
            {"max_uneven", max_uneven, range(0, 2)}};
  }
  void check() const;
};

// `points`: 2 x 68 in the image, or empty. Without points, turn is computed from the difference
// between the face and its mirror image, and tilt is 0.
[[nodiscard]] Quality measure_quality(const cv::Mat& crop, const Eyes& eyes,
                                      const Eigen::Matrix2Xd& points);

// Reasons not to enrol the face, each once, in a fixed order: "too small", "blurred", "turned
// away", "tilted up", "tilted down", "too dark", "too bright", "too little contrast",
// "overexposed", "lit from one side". Empty: good.
[[nodiscard]] std::vector<std::string> quality_problems(const Quality& quality,
                                                        const QualityGate& gate);

[[nodiscard]] nlohmann::ordered_json quality_json(const Quality& quality);

}  // namespace tarsier::face::people
