// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/face/appearance/training_image.h"

#include <opencv2/imgproc.hpp>

#include <cmath>
#include <vector>

namespace tarsier::face::appearance::test_support {

// A 4 x 4 grid of points on a smooth coloured pattern that deforms with it: two shape modes
// (height, and a bend of the middle), one texture mode.
inline TrainingImage portrait(Rng& rng) {
  const double height = 1 + rng.uniform(-0.15, 0.15);
  const double bend = rng.uniform(-0.12, 0.12);
  const double light = rng.uniform(-25, 25);
  const double unit = rng.uniform(32, 40);
  const double angle = rng.normal(0, 0.06);
  const Eigen::Vector2d center(80 + rng.uniform(-5, 5), 80 + rng.uniform(-5, 5));
  const auto image_point = [&](double u, double v) {
    const double x = u + bend * (1 - v * v);
    const double y = v * height;
    return Eigen::Vector2d(center.x() + unit * (std::cos(angle) * x - std::sin(angle) * y),
                           center.y() + unit * (std::sin(angle) * x + std::cos(angle) * y));
  };
  TrainingImage result;
  result.points.resize(2, 16);
  for (int i = 0; i < 16; ++i) {
    result.points.col(i) = image_point(-1 + (i % 4) * 2.0 / 3, -1 + (i / 4) * 2.0 / 3);
  }
  result.image = cv::Mat(160, 160, CV_8UC3);
  for (int y = 0; y < 160; ++y) {
    for (int x = 0; x < 160; ++x) {
      const double dx = (x - center.x()) / unit;
      const double dy = (y - center.y()) / unit;
      const double v = (-std::sin(angle) * dx + std::cos(angle) * dy) / height;
      const double u = std::cos(angle) * dx + std::sin(angle) * dy - bend * (1 - v * v);
      const double pattern = 128 + 45 * std::sin(3.1 * u + 0.5) * std::cos(2.7 * v) +
                             35 * std::cos(4.3 * u - 1.9 * v) + light * std::sin(1.5 * u);
      result.image.at<cv::Vec3b>(y, x) = cv::Vec3b(cv::saturate_cast<std::uint8_t>(pattern),
                                                   cv::saturate_cast<std::uint8_t>(pattern * 0.9),
                                                   cv::saturate_cast<std::uint8_t>(pattern * 0.8));
    }
  }
  return result;
}

inline std::vector<TrainingImage> portraits(int count, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<TrainingImage> result;
  result.reserve(count);
  for (int i = 0; i < count; ++i) result.push_back(portrait(rng));
  return result;
}

}  // namespace tarsier::face::appearance::test_support
