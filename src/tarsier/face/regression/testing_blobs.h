// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/face/regression/training_face.h"

#include <opencv2/imgproc.hpp>

#include <cmath>
#include <vector>

namespace tarsier::face::regression::test_support {

// A synthetic "face" of bright disks of different sizes on a dim gradient, at known positions: nine
// disks whose spacing varies by one mode. It is mirror-symmetric.
inline Eigen::Matrix2Xd blob_shape(double stretch) {
  Eigen::Matrix2Xd points(2, 9);
  points << -1, 0, 1, -1, 0, 1, -1, 0, 1, -1, -1, -1, 0, 0, 0, 1, 1, 1;
  points.row(1) *= 1 + stretch;
  return points;
}

inline cv::Mat draw_blobs(const Eigen::Matrix2Xd& points, double unit, cv::Size size, Rng& rng) {
  cv::Mat image(size, CV_32FC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      double value = 60 + 0.1 * y + 4 * rng.normal();
      for (Eigen::Index p = 0; p < points.cols(); ++p) {
        const double radius = unit * (0.12 + 0.02 * static_cast<double>(p / 3));
        const double d = std::hypot(x - points(0, p), y - points(1, p)) / radius;
        value += (p % 3 == 1 ? 70 : 110) * std::exp(-d * d);
      }
      image.at<float>(y, x) = static_cast<float>(value);
    }
  }
  cv::Mat gray;
  image.convertTo(gray, CV_8U);
  return gray;
}

inline TrainingFace blob_face(Rng& rng, cv::Size size = {160, 160}) {
  const double unit = rng.uniform(24, 32);
  const double angle = rng.normal(0, 0.08);
  const shape::Similarity2d similarity{unit * std::cos(angle), unit * std::sin(angle),
                                       size.width / 2.0 + rng.uniform(-8, 8),
                                       size.height / 2.0 + rng.uniform(-8, 8)};
  TrainingFace face;
  face.points = similarity(blob_shape(rng.uniform(-0.2, 0.2)));
  face.gray = draw_blobs(face.points, unit, size, rng);
  return face;
}

inline std::vector<TrainingFace> blob_faces(int count, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<TrainingFace> faces;
  for (int i = 0; i < count; ++i) faces.push_back(blob_face(rng));
  return faces;
}

}  // namespace tarsier::face::regression::test_support
