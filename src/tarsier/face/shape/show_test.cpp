// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/show.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <stdexcept>

namespace tarsier::face::shape {
namespace {

cv::Vec3b at(const cv::Mat& image, double x, double y) {
  return image.at<cv::Vec3b>(cvRound(y), cvRound(x));
}

TEST(DrawLandmarks, HiddenPointRingsHaveRadiusSigma) {
  const cv::Mat empty(200, 200, CV_8UC3, cv::Scalar(0, 0, 0));
  Eigen::Matrix2Xd points(2, 2);
  points << 50, 140, 100, 100;
  LandmarkStyle style;
  style.radius_px = 2;
  style.hidden = {true, false};
  style.sigma_px = Eigen::Vector2d(20, 30);
  cv::Mat image = empty.clone();
  draw_landmarks(image, points, {}, {}, style);
  EXPECT_NE(at(image, 70, 100), cv::Vec3b(0, 0, 0));  // the ring, and an empty interior
  EXPECT_EQ(at(image, 60, 100), cv::Vec3b(0, 0, 0));
  EXPECT_EQ(at(image, 50, 100), cv::Vec3b(0, 0, 0));
  EXPECT_NE(at(image, 140, 100), cv::Vec3b(0, 0, 0));  // a point
  EXPECT_EQ(at(image, 170, 100), cv::Vec3b(0, 0, 0));  // without its circle
  style.all_sigmas = true;
  draw_landmarks(image, points, {}, {}, style);
  EXPECT_NE(at(image, 170, 100), cv::Vec3b(0, 0, 0));
  // Small and unknown deviations: a ring of a fixed size.
  for (const Eigen::VectorXd& sigma :
       {Eigen::VectorXd(Eigen::Vector2d(0.1, NAN)), Eigen::VectorXd()}) {
    style.sigma_px = sigma;
    image = empty.clone();
    draw_landmarks(image, points, {}, {}, style);
    EXPECT_NE(at(image, 52.6, 100), cv::Vec3b(0, 0, 0));
    EXPECT_EQ(at(image, 70, 100), cv::Vec3b(0, 0, 0));
    EXPECT_EQ(at(image, 170, 100), cv::Vec3b(0, 0, 0));
  }
  style.sigma_px = Eigen::Vector3d(1, 1, 1);
  EXPECT_THROW(draw_landmarks(image, points, {}, {}, style), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::shape
