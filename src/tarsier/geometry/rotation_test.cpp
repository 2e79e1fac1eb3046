// SPDX-License-Identifier: MIT
#include "tarsier/geometry/rotation.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::geometry {
namespace {

TEST(Rotation, RotationVectorIsRodrigues) {
  for (const double angle : {0.0, 1e-9, 0.7, 3.1, CV_PI}) {
    const cv::Vec3d axis = cv::normalize(cv::Vec3d(0.3, -0.5, 0.8));
    const double half = angle / 2;
    const cv::Matx33d r = rotation_of({std::cos(half), std::sin(half) * axis[0],
                                       std::sin(half) * axis[1], std::sin(half) * axis[2]});
    const cv::Vec3d v = rotation_vector(r);
    EXPECT_NEAR(cv::norm(v), angle, 1e-7) << angle;
    if (angle > 0.1) {
      EXPECT_NEAR(std::abs(v.dot(axis)), angle, 1e-7) << angle;
    }
  }
}

TEST(Rotation, InterpolatesAtEvenSpeed) {
  const cv::Matx33d a = rotation_of({1, 0, 0, 0});
  const cv::Matx33d b = rotation_of({std::cos(0.5), 0, std::sin(0.5), 0});  // 1 radian
  EXPECT_NEAR(angle_of(interpolate(a, b, 0.25)), 0.25, 1e-9);
  EXPECT_NEAR(angle_of(interpolate(b, a, 1)), 0, 1e-9);
}

}  // namespace
}  // namespace tarsier::geometry
