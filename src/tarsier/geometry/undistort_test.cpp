// SPDX-License-Identifier: MIT
#include "tarsier/geometry/undistort.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>

namespace tarsier::geometry {
namespace {

// A straight dark line in the world, y = 0.2 + 0.1 x, as the camera images it.
cv::Mat line_through(const Camera& camera) {
  cv::Mat image(camera.height, camera.width, CV_8UC1);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const auto ray = camera.normalized_of(cv::Point2d(u, v));
      const double distance = ray ? std::abs(ray->y - 0.2 - 0.1 * ray->x) : 1;
      image.at<uchar>(v, u) = distance < 0.02 ? 0 : 255;
    }
  }
  return image;
}

// Largest distance between the line's middle and the ideal line, px.
double max_line_error_px(const cv::Mat& image, const Camera& camera) {
  double max_error = 0;
  for (int u = 0; u < image.cols; u += 7) {
    double sum = 0;
    double weight = 0;
    for (int v = 0; v < image.rows; ++v) {
      const double dark = 255.0 - image.at<uchar>(v, u);
      sum += dark * v;
      weight += dark;
    }
    const double x = (u - camera.cx) / camera.fx;
    const double expected = camera.fy * (0.2 + 0.1 * x) + camera.cy;
    if (expected > 12 && expected < image.rows - 12)
      max_error = std::max(max_error, std::abs(sum / weight - expected));
  }
  return max_error;
}

TEST(UndistortTest, LinesOfEveryLensBecomeStraight) {
  const Camera rational{320,
                        240,
                        200,
                        200,
                        158,
                        121,
                        {-0.3, 0.1, 1e-3, -1e-3, 0.01, 0.1, 0.02, 0},
                        0,
                        Lens::kRational};
  const Camera fisheye{320, 240, 130, 130, 158, 121, {0.03, -0.01, 0, 0}, 0, Lens::kFisheye};
  for (const Camera& camera : {rational, fisheye}) {
    const Camera straight = undistorted_camera(camera);
    EXPECT_FALSE(straight.is_distorted());
    EXPECT_NO_THROW(straight.check());
    const cv::Mat distorted = line_through(camera);
    const cv::Mat image = undistort_image(distorted, camera, straight);
    EXPECT_LT(max_line_error_px(image, straight), 1.0) << name_of(camera.lens);
    EXPECT_GT(max_line_error_px(distorted, straight), 3.0) << name_of(camera.lens);
  }
}

TEST(UndistortTest, AFisheyeOf180DegreesKeepsItsCenter) {
  const Camera camera{640, 640, 204, 204, 319.5, 319.5, {}, 0, Lens::kFisheye};  // 180 degrees
  const Camera straight = undistorted_camera(camera);
  EXPECT_NEAR(straight.fx, 639 / 3.6, 1e-9);
  EXPECT_EQ(straight.fx, straight.fy);
  EXPECT_NEAR(straight.cx, 319.5, 1e-9);
}

}  // namespace
}  // namespace tarsier::geometry
