// SPDX-License-Identifier: MIT
#include "tarsier/geometry/rigid.h"

#include "tarsier/core/require.h"

#include <cmath>

namespace tarsier::geometry {

// Shepperd's method: the largest of the four is found first, so that nothing is divided by a small
// number.
cv::Vec4d quaternion_of(const cv::Matx33d& r) {
  const double trace = r(0, 0) + r(1, 1) + r(2, 2);
  cv::Vec4d q;
  if (trace >= r(0, 0) && trace >= r(1, 1) && trace >= r(2, 2)) {
    q = {1 + trace, r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)};
  } else {
    int i = 0;
    if (r(1, 1) > r(0, 0)) i = 1;
    if (r(2, 2) > r(i, i)) i = 2;
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    q[0] = r(k, j) - r(j, k);
    q[1 + i] = 1 + r(i, i) - r(j, j) - r(k, k);
    q[1 + j] = r(j, i) + r(i, j);
    q[1 + k] = r(k, i) + r(i, k);
  }
  const double length = cv::norm(q);
  TARSIER_REQUIRE(length > 0 && std::isfinite(length), "no rotation matrix");
  return q * ((q[0] < 0 ? -1 : 1) / length);
}

cv::Matx33d rotation_of(const cv::Vec4d& quaternion) {
  const double length = cv::norm(quaternion);
  TARSIER_REQUIRE(length > 0 && std::isfinite(length), "quaternion of length {}", length);
  const cv::Vec4d q = quaternion * (1 / length);
  const double w = q[0];
  const double x = q[1];
  const double y = q[2];
  const double z = q[3];
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

// From sine and cosine both: each alone loses half its digits near one of the ends.
double angle_of(const cv::Matx33d& r) {
  const cv::Vec3d twice_sine(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  return std::atan2(cv::norm(twice_sine), r(0, 0) + r(1, 1) + r(2, 2) - 1);
}

}  // namespace tarsier::geometry
