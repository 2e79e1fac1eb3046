// SPDX-License-Identifier: MIT
#include "tarsier/face/head/draw_pose.h"

#include "tarsier/face/head/testing_head.h"

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <cstdlib>
#include <limits>
#include <string>

namespace tarsier::face::head {
namespace {

cv::Mat canvas() { return {480, 640, CV_8UC3, cv::Scalar(60, 60, 60)}; }

int changed(const cv::Mat& image) {
  cv::Mat difference;
  cv::absdiff(image, canvas(), difference);
  cv::cvtColor(difference, difference, cv::COLOR_BGR2GRAY);
  return cv::countNonZero(difference);
}

TEST(DrawAxes, DrawsEachAxisInItsColour) {
  cv::Mat image = canvas();
  // x to the right in red, y down in green.
  draw_axes(image, testing_camera(), {Eigen::Matrix3d::Identity(), {0, 0, 500}}, {60, 60, 0},
            false);
  const cv::Vec3b right = image.at<cv::Vec3b>(240, 320 + 48);
  EXPECT_GT(right[2], 200);
  EXPECT_LT(right[0], 120);
  const cv::Vec3b below = image.at<cv::Vec3b>(240 + 48, 320);
  EXPECT_GT(below[1], 200);
  EXPECT_LT(below[2], 120);
  EXPECT_EQ(image.at<cv::Vec3b>(240, 320 - 30), cv::Vec3b(60, 60, 60));
}

TEST(DrawPose, ClipsBehindTheCamera) {
  cv::Mat image = canvas();
  draw_axes(image, testing_camera(), {Eigen::Matrix3d::Identity(), {0, 0, -500}}, {60, 60, 60});
  draw_box(image, testing_camera(), {Eigen::Matrix3d::Identity(), {0, 0, -500}}, {-9, -9, -9},
           {9, 9, 9});
  const HeadModel model = testing_head(0);
  draw_head(image, testing_camera(), {Eigen::Matrix3d::Identity(), {0, 0, -500}}, model,
            model.mean);
  EXPECT_EQ(changed(image), 0);
  // Around the camera: parts of it, no error.
  draw_box(image, testing_camera(), {Eigen::Matrix3d::Identity(), {1, 2, 0}}, {-90, -90, -90},
           {90, 90, 900});
  draw_axes(image, testing_camera(), {Eigen::Matrix3d::Identity(), {1, 2, 3}}, {1e6, 10, -50});
  EXPECT_GT(changed(image), 0);
  cv::Mat none;
  EXPECT_THROW(draw_axes(none, testing_camera(), {}, {1, 1, 1}), std::invalid_argument);
  EXPECT_THROW(draw_axes(image, testing_camera(), {Eigen::Matrix3d::Identity(), {0, 0, 9}},
                         {std::numeric_limits<double>::quiet_NaN(), 1, 1}),
               std::invalid_argument);
}

TEST(DrawBox, ShowsHiddenEdgesDarker) {
  cv::Mat image = canvas();
  // Seen from the front, a little from above and left: the corner (low, high, high) is hidden.
  const geometry::Rigid3 pose{rotation_of_angles({30, -25, 0}), {0, 0, 600}};
  draw_box(image, testing_camera(), pose, {-60, -60, -60}, {60, 60, 60}, {0, 220, 255});
  if (const char* folder = std::getenv("TARSIER_TEST_IMAGES"))
    cv::imwrite(std::string(folder) + "/box.png", image);
  int bright = 0;
  int dark = 0;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const cv::Vec3b pixel = image.at<cv::Vec3b>(y, x);
      if (pixel[2] > 240) ++bright;
      if (pixel[2] > 110 && pixel[2] < 140 && pixel[1] > 95 && pixel[1] < 120) ++dark;
    }
  }
  EXPECT_GT(bright, 1000);
  EXPECT_GT(dark, 100);
  EXPECT_LT(dark, bright);
}

TEST(DrawHead, DrawsAtTheProjectedPoints) {
  const std::string models = TARSIER_SOURCE_MODELS;
  const HeadModel model = read_head_model(models + "/head.json");
  cv::Mat sheet(480, 1280, CV_8UC3);
  int at = 0;
  for (const HeadAngles& angles : {HeadAngles{30, 0, 0}, HeadAngles{0, 20, 15}}) {
    cv::Mat image = sheet(cv::Rect(640 * at++, 0, 640, 480));
    canvas().copyTo(image);
    const geometry::Rigid3 pose{rotation_of_angles(angles), {0, -40, 600}};
    draw_head(image, testing_camera(), pose, model, model.mean);
    draw_axes(image, testing_camera(), pose, {60, 60, -90});
    EXPECT_GT(changed(image), 2000);
    const auto eye = testing_camera().project(pose * model.mean.col(36));
    const cv::Vec3b pixel = image.at<cv::Vec3b>(cvRound(eye->y), cvRound(eye->x));
    EXPECT_GT(pixel[2], 200);
  }
  if (const char* folder = std::getenv("TARSIER_TEST_IMAGES"))
    cv::imwrite(std::string(folder) + "/head.png", sheet);
}

}  // namespace
}  // namespace tarsier::face::head
