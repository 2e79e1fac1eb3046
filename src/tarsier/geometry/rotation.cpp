// SPDX-License-Identifier: MIT
#include "tarsier/geometry/rotation.h"

#include <algorithm>
#include <cmath>

namespace tarsier::geometry {

cv::Vec3d rotation_vector(const cv::Matx33d& rotation) {
  const cv::Vec4d q = quaternion_of(rotation);
  const cv::Vec3d axis(q[1], q[2], q[3]);
  const double sine = cv::norm(axis);
  if (sine < 1e-12) return 2 * axis;
  return axis * (2 * std::atan2(sine, q[0]) / sine);
}

cv::Matx33d interpolate(const cv::Matx33d& a, const cv::Matx33d& b, double part) {
  const cv::Vec4d p = quaternion_of(a);
  cv::Vec4d q = quaternion_of(b);
  double cosine = p.dot(q);
  if (cosine < 0) {
    q = -q;
    cosine = -cosine;
  }
  const double angle = std::acos(std::min(cosine, 1.0));
  cv::Vec4d between = (1 - part) * p + part * q;
  if (angle > 1e-6) {
    between =
        (std::sin((1 - part) * angle) * p + std::sin(part * angle) * q) * (1 / std::sin(angle));
  }
  return rotation_of(between * (1 / cv::norm(between)));
}

}  // namespace tarsier::geometry
