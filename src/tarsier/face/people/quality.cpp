// SPDX-License-Identifier: MIT
#include "tarsier/face/people/quality.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::face::people {
namespace {

// In the mean face: distance of the nose base below the eyes, in eye distances.
constexpr double kMeanNoseDistance = 0.67;

// The oval of the face in the crop, without hair and background.
cv::Mat oval(cv::Size size) {
  cv::Mat mask = cv::Mat::zeros(size, CV_8UC1);
  cv::ellipse(mask, {size.width / 2, cvRound(0.52 * size.height)},
              {cvRound(0.42 * size.width), cvRound(0.45 * size.height)}, 0, 0, 360, cv::Scalar(255),
              cv::FILLED);
  return mask;
}

double ramp(double value, double low, double high) {
  return std::clamp((value - low) / (high - low), 0.0, 1.0);
}

double round4(double value) { return std::round(value * 1e4) / 1e4; }

}  // namespace

double Quality::score() const {
  const QualityGate gate;
  return std::min({ramp(eye_distance, gate.min_eye_distance / 2, 2.5 * gate.min_eye_distance),
                   ramp(sharpness, gate.min_sharpness / 2, 1.6 * gate.min_sharpness),
                   1 - ramp(std::abs(turn), 0.05, 2 * gate.max_turn),
                   1 - ramp(std::abs(tilt), 0.05, 2 * gate.max_tilt),
                   ramp(light, gate.min_light / 2, 2 * gate.min_light), 1 - ramp(light, 190, 250),
                   ramp(contrast, 6, 24), 1 - ramp(clipped, 0.1, 0.6), 1 - ramp(uneven, 0.25, 1)});
}

void QualityGate::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(min_light < max_light, "light {}..{}", min_light, max_light);
}

Quality measure_quality(const cv::Mat& crop, const Eyes& eyes, const Eigen::Matrix2Xd& points) {
  require_gray(crop);
  Quality out;
  out.eye_distance = eyes.distance();
  cv::Mat small;
  cv::resize(crop, small, {64, 80}, 0, 0, cv::INTER_AREA);
  const cv::Mat mask = oval(small.size());
  cv::Mat values;
  small.convertTo(values, CV_32F);
  cv::Mat blurred;
  cv::GaussianBlur(values, blurred, {}, 1.5);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(values, mean, deviation, mask);
  out.contrast = deviation[0];
  cv::Scalar fine_mean;
  cv::Scalar fine;
  cv::meanStdDev(cv::Mat(values - blurred), fine_mean, fine, mask);
  out.sharpness = fine[0] / std::max(4.0, deviation[0]);

  std::vector<int> counts(256, 0);
  int total = 0;
  double halves[2] = {0, 0};
  for (int y = 0; y < small.rows; ++y) {
    for (int x = 0; x < small.cols; ++x) {
      if (mask.at<unsigned char>(y, x) == 0) continue;
      const int grey = small.at<unsigned char>(y, x);
      ++counts[static_cast<std::size_t>(grey)];
      ++total;
      halves[x < small.cols / 2 ? 0 : 1] += grey;
      if (grey < 4 || grey > 251) out.clipped += 1;
    }
  }
  out.clipped /= total;
  int below = 0;
  for (int grey = 0; grey < 256; ++grey) {
    below += counts[static_cast<std::size_t>(grey)];
    if (2 * below >= total) {
      out.light = grey;
      break;
    }
  }
  out.uneven = std::abs(halves[0] - halves[1]) / std::max(1.0, halves[0] + halves[1]);

  if (points.cols() == 68 && out.eye_distance > 0) {
    const Eigen::Vector2d left = points.middleCols(36, 6).rowwise().mean();
    const Eigen::Vector2d right = points.middleCols(42, 6).rowwise().mean();
    const Eigen::Vector2d nose = points.middleCols(30, 6).rowwise().mean();
    const Eigen::Vector2d across = (right - left).normalized();
    const Eigen::Vector2d down(-across.y(), across.x());
    const Eigen::Vector2d nose_offset = (nose - 0.5 * (left + right)) / out.eye_distance;
    out.turn = nose_offset.dot(across);
    out.tilt = nose_offset.dot(down) - kMeanNoseDistance;
  } else {
    // Turned faces differ from their mirror image even after light normalisation.
    cv::Mat normalized;
    cv::GaussianBlur(values, blurred, {}, 6);
    cv::divide(values, blurred + 8, normalized);
    cv::Mat mirrored;
    cv::flip(normalized, mirrored, 1);
    cv::Scalar normalized_mean;
    cv::Scalar normalized_deviation;
    cv::meanStdDev(normalized, normalized_mean, normalized_deviation, mask);
    const cv::Mat product = (normalized - normalized_mean[0]).mul(mirrored - normalized_mean[0]);
    const double correlation = cv::mean(product, mask)[0] /
                               std::max(1e-6, normalized_deviation[0] * normalized_deviation[0]);
    out.turn = 0.5 * (1 - std::clamp(correlation, 0.0, 1.0));
  }
  return out;
}

std::vector<std::string> quality_problems(const Quality& quality, const QualityGate& gate) {
  gate.check();
  std::vector<std::string> out;
  if (quality.eye_distance < gate.min_eye_distance) out.emplace_back("too small");
  if (quality.sharpness < gate.min_sharpness) out.emplace_back("blurred");
  if (std::abs(quality.turn) > gate.max_turn) out.emplace_back("turned away");
  if (quality.tilt < -gate.max_tilt) out.emplace_back("tilted up");
  if (quality.tilt > gate.max_tilt) out.emplace_back("tilted down");
  if (quality.light < gate.min_light) out.emplace_back("too dark");
  if (quality.light > gate.max_light) out.emplace_back("too bright");
  if (quality.contrast < gate.min_contrast) out.emplace_back("too little contrast");
  if (quality.clipped > gate.max_clipped) out.emplace_back("overexposed");
  if (quality.uneven > gate.max_uneven) out.emplace_back("lit from one side");
  return out;
}

nlohmann::ordered_json quality_json(const Quality& quality) {
  return {{"score", round4(quality.score())},       {"eye_distance", round4(quality.eye_distance)},
          {"sharpness", round4(quality.sharpness)}, {"turn", round4(quality.turn)},
          {"tilt", round4(quality.tilt)},           {"light", quality.light},
          {"contrast", round4(quality.contrast)},   {"clipped", round4(quality.clipped)},
          {"uneven", round4(quality.uneven)}};
}

}  // namespace tarsier::face::people
