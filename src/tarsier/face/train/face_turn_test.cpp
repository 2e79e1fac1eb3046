// SPDX-License-Identifier: MIT
#include "tarsier/face/train/face_turn.h"

#include "tarsier/face/head/head_model.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <string>
#include <vector>

namespace tarsier::face::train {
namespace {

using Eigen::Matrix2Xd;

const std::string kModels = TARSIER_SOURCE_MODELS;

constexpr int kSide = 420;

// The mean head of the installed model, from a distance of one metre, 200 px wide.
class FaceTurnTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    head_ = std::make_unique<head::HeadModel>(head::read_head_model(kModels + "/head.json"));
    turner_ = std::make_unique<FaceTurner>(*head_);
  }
  static void TearDownTestSuite() {
    turner_.reset();
    head_.reset();
  }
  static geometry::Camera camera() {
    geometry::Camera camera;
    camera.width = camera.height = kSide;
    camera.fx = camera.fy = 1400;
    camera.cx = camera.cy = kSide / 2.0;
    return camera;
  }
  static Matrix2Xd projected(const head::HeadAngles& angles) {
    head::HeadPose pose;
    pose.camera_from_head = {head::rotation_of_angles(angles), {0, -20, 1000}};
    pose.b = Eigen::VectorXd::Zero(head_->mode_count());
    return head::HeadPoseEstimator(*head_).project(pose, camera());
  }
  static head::HeadAngles angles_of(const Matrix2Xd& points) {
    return head::HeadPoseEstimator(*head_).pose(points, camera()).pose->angles;
  }
  // A smooth image, so that interpolation between the points hardly matters.
  static cv::Mat background_image() {
    cv::Mat image(kSide, kSide, CV_8UC1);
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x)
        image.at<std::uint8_t>(y, x) =
            cv::saturate_cast<std::uint8_t>(90 + 25 * std::sin(x / 31.0) + 25 * std::cos(y / 23.0));
    return image;
  }
  static regression::TrainingFace face(const head::HeadAngles& angles) {
    regression::TrainingFace result;
    result.gray = background_image();
    result.points = projected(angles);
    result.name = "mean";
    return result;
  }

  static std::unique_ptr<head::HeadModel> head_;
  static std::unique_ptr<FaceTurner> turner_;
};
std::unique_ptr<head::HeadModel> FaceTurnTest::head_;
std::unique_ptr<FaceTurner> FaceTurnTest::turner_;

TEST_F(FaceTurnTest, ZeroRotationKeepsPointsAndImage) {
  Matrix2Xd points = projected({12, -8, 6});
  // Other points than the model's: the annotation is kept exactly.
  for (int i = 0; i < points.cols(); ++i) points(i % 2, i) += i % 3 - 1.0;
  const cv::Mat image = background_image();
  const auto turned = turner_->turn(image, points, 0, 0);
  ASSERT_TRUE(turned.has_value());
  EXPECT_LT((turned->points - points).cwiseAbs().maxCoeff(), 1e-6);
  cv::Mat difference;
  cv::absdiff(turned->gray, image, difference);
  double max_difference = 0;
  cv::minMaxLoc(difference, nullptr, &max_difference);
  EXPECT_LE(max_difference, 1);
}

TEST_F(FaceTurnTest, RotatesByTheGivenAngles) {
  for (const auto& [yaw, pitch] :
       {std::pair{0.0, -25.0}, {0.0, 25.0}, {20.0, 10.0}, {-25.0, -15.0}}) {
    const auto turned = turner_->turn(background_image(), projected({5, -3, 8}), pitch, yaw);
    ASSERT_TRUE(turned.has_value()) << yaw << ' ' << pitch;
    const head::HeadAngles now = angles_of(turned->points);
    EXPECT_NEAR(now.yaw_deg, 5 + yaw, 2) << pitch;
    EXPECT_NEAR(now.pitch_deg, -3 + pitch, 2) << yaw;
    EXPECT_NEAR(now.roll_deg, 8, 1.5);
    EXPECT_NEAR(turned->after.pitch_deg - turned->before.pitch_deg, pitch, 1e-9);
    const Eigen::Vector2d moved =
        turned->points.rowwise().mean() - projected({5, -3, 8}).rowwise().mean();
    EXPECT_LT(moved.norm(), 1e-6);
  }
}

// Points of the inner face of a rotated head agree with the projection of that head in the new
// pose.
TEST_F(FaceTurnTest, PointsEqualTheProjectedHead) {
  const Matrix2Xd before = projected({0, 0, 0});
  const auto turned = turner_->turn(background_image(), before, 20, 0);
  ASSERT_TRUE(turned.has_value());
  Matrix2Xd expected = projected({0, 20, 0});
  expected.colwise() += before.rowwise().mean() - expected.rowwise().mean();
  EXPECT_LT((turned->points - expected).colwise().norm().maxCoeff(), 3);  // of 200 px
}

TEST_F(FaceTurnTest, ImageMovesWithThePoints) {
  const std::vector<int> marked{8, 19, 30, 36, 45, 48, 54};
  const Matrix2Xd points = projected({0, 0, 0});
  cv::Mat image = background_image();
  for (const int i : marked) {
    cv::circle(image, {cvRound(points(0, i) * 16), cvRound(points(1, i) * 16)}, 3 * 16, 255, -1,
               cv::LINE_AA, 4);
  }
  const auto turned = turner_->turn(image, points, -18, 14);
  ASSERT_TRUE(turned.has_value());
  for (const int i : marked) {
    double sum = 0;
    Eigen::Vector2d middle(0, 0);
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const Eigen::Vector2d at(x, y);
        const double bright = std::max(0, turned->gray.at<std::uint8_t>(y, x) - 180);
        if ((at - turned->points.col(i)).norm() > 9) continue;
        sum += bright;
        middle += bright * at;
      }
    }
    ASSERT_GT(sum, 500) << i;
    EXPECT_LT((middle / sum - turned->points.col(i)).norm(), 1.5) << i;
  }
}

TEST_F(FaceTurnTest, BackgroundIsNotChanged) {
  const cv::Mat image = background_image();
  const auto turned = turner_->turn(image, projected({0, 0, 0}), 25, 15);
  ASSERT_TRUE(turned.has_value());
  for (const cv::Point corner : {cv::Point(0, 0), {kSide - 1, 0}, {0, kSide - 1}})
    EXPECT_NEAR(turned->gray.at<std::uint8_t>(corner), image.at<std::uint8_t>(corner), 1);
}

TEST_F(FaceTurnTest, RejectsInvalidAnglesAndInput) {
  const Matrix2Xd points = projected({0, 0, 0});
  EXPECT_FALSE(
      turner_->turn(background_image(), points, 0, 75).has_value());  // half the face is hidden
  EXPECT_FALSE(turner_->turn(background_image(), points, 0, 120).has_value());
  const Matrix2Xd coincident = Matrix2Xd::Constant(2, points.cols(), 100);
  EXPECT_FALSE(turner_->turn(background_image(), coincident, 10, 0).has_value());
  EXPECT_THROW((void)turner_->turn(background_image(), points.leftCols(20), 10, 0),
               std::invalid_argument);
  EXPECT_THROW((void)turner_->turn(cv::Mat(20, 20, CV_8UC3), points, 10, 0), std::invalid_argument);
  Matrix2Xd missing = points;
  missing(0, 3) = std::nan("");
  EXPECT_THROW((void)turner_->turn(background_image(), missing, 10, 0), std::invalid_argument);
}

TEST_F(FaceTurnTest, CopiesRespectTheOptions) {
  CopyOptions options;
  options.copies = 6;
  options.min_pitch_deg = 12;
  const regression::TrainingFace from = face({10, 0, 0});
  const auto copies = turned_copies(*turner_, from, options, 5);
  ASSERT_EQ(copies.size(), 6U);
  int up = 0;
  for (const regression::TrainingFace& copy : copies) {
    EXPECT_TRUE(copy.turned);
    EXPECT_EQ(copy.name, "mean");
    const head::HeadAngles now = angles_of(copy.points);
    EXPECT_GT(std::abs(now.pitch_deg), 10);
    EXPECT_LT(std::abs(now.pitch_deg), 33);
    EXPECT_GT(now.yaw_deg,
              -14);  // -10 straight back and further, by at max_difference max_back_deg
    EXPECT_LT(now.yaw_deg, 43);
    up += now.pitch_deg > 0 ? 1 : 0;
  }
  EXPECT_GT(up, 0);
  EXPECT_LT(up, 6);
  const auto again = turned_copies(*turner_, from, options, 5);
  ASSERT_EQ(again.size(), 6U);
  EXPECT_EQ(again[3].points, copies[3].points);
  EXPECT_EQ(cv::norm(again[3].gray, copies[3].gray, cv::NORM_INF), 0);
  EXPECT_NE(turned_copies(*turner_, from, options, 6)[0].points, copies[0].points);
}

TEST_F(FaceTurnTest, RejectsInvalidOptions) {
  CopyOptions options;
  options.copies = 21;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options.copies = 1;
  options.min_pitch_deg = 31;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

TEST_F(FaceTurnTest, ShapesNearHaveSimilarPoses) {
  const Matrix2Xd points = projected({35, 20, 0});
  const auto shapes = turner_->shapes_near(points, 40, 1);
  ASSERT_EQ(shapes.size(), 40U);
  double yaw = 0;
  double pitch = 0;
  for (const Matrix2Xd& shape : shapes) {
    EXPECT_LT((shape - points).colwise().norm().mean(), 35);
    yaw += angles_of(shape).yaw_deg / 40;
    pitch += angles_of(shape).pitch_deg / 40;
  }
  EXPECT_NEAR(yaw, 35 * 0.85, 5);  // between 60 and 110 %
  EXPECT_NEAR(pitch, 20 * 0.85, 4);
  EXPECT_EQ(turner_->shapes_near(points, 40, 1)[7], shapes[7]);
}

}  // namespace
}  // namespace tarsier::face::train
