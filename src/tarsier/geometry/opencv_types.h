// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core/matx.hpp>
#include <opencv2/core/types.hpp>

// Geometry uses Eigen. These functions convert to and from the types of OpenCV.
namespace tarsier::geometry {

[[nodiscard]] inline cv::Vec3d to_cv(const Eigen::Vector3d& v) { return {v[0], v[1], v[2]}; }
[[nodiscard]] inline cv::Matx33d to_cv(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)};
}
template <class T>
[[nodiscard]] Eigen::Vector3d to_eigen(const cv::Vec<T, 3>& v) {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}
[[nodiscard]] inline Eigen::Matrix3d to_eigen(const cv::Matx33d& m) {
  Eigen::Matrix3d result;
  result << m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2);
  return result;
}

}  // namespace tarsier::geometry
