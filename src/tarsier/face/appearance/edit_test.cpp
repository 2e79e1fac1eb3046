// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/edit.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <memory>
#include <string>

namespace tarsier::face::appearance {
namespace {

class EditTest : public ::testing::Test {
 protected:
  static const AppearanceModel& model() {
    static const AppearanceModel result =
        read_appearance_model(std::string(TARSIER_SOURCE_MODELS) + "/aam68.json");
    return result;
  }
  EditTest() : synthesis_(model()) { image_ = synthesis_.portrait({}, {}, {300, 300}, &points_); }
  double mouth_of(const Eigen::Matrix2Xd& points) {  // how far open, px
    return points(1, 66) - points(1, 62);
  }
  double brows_of(const Eigen::Matrix2Xd& points) {  // above the eyes
    return points.middleCols(36, 12).row(1).mean() - points.middleCols(17, 10).row(1).mean();
  }
  Synthesis synthesis_;
  Eigen::Matrix2Xd points_;
  cv::Mat image_;
};

TEST_F(EditTest, OpenMouthMovesLipsAndKeepsEyes) {
  const Eigen::Matrix2Xd open = edited_points(model(), points_, FaceEdit::kOpenMouth);
  EXPECT_GT(mouth_of(open), mouth_of(points_) + 12);
  EXPECT_LT((open - points_).middleCols(36, 12).colwise().norm().maxCoeff(), 8);
  const Eigen::Matrix2Xd half = edited_points(model(), points_, FaceEdit::kOpenMouth, 0.5);
  EXPECT_GT(mouth_of(half), mouth_of(points_) + 4);
  EXPECT_LT(mouth_of(half), mouth_of(open));
}

TEST_F(EditTest, RaiseBrowsMovesBrowsUp) {
  const Eigen::Matrix2Xd raised = edited_points(model(), points_, FaceEdit::kRaiseBrows);
  EXPECT_GT(brows_of(raised), brows_of(points_) + 3);
}

TEST_F(EditTest, ZeroAmountChangesNothing) {
  const Eigen::Matrix2Xd same = edited_points(model(), points_, FaceEdit::kOpenMouth, 0);
  EXPECT_LT((same - points_).cwiseAbs().maxCoeff(), 1e-6);
  cv::Mat drawn = image_.clone();
  draw_edited(synthesis_, model(), drawn, points_, points_);
  // The pixels between the lips are the model's own.
  EXPECT_LT(cv::norm(drawn, image_, cv::NORM_L1) / static_cast<double>(image_.total()), 1.5);
}

TEST_F(EditTest, DrawEditedMovesPixelsWithPoints) {
  const Eigen::Matrix2Xd open = edited_points(model(), points_, FaceEdit::kOpenMouth);
  cv::Mat drawn = image_.clone();
  draw_edited(synthesis_, model(), drawn, points_, open);
  // The colour of the lower lip moves with the lip. Far from the face nothing changes.
  const cv::Vec3b was = image_.at<cv::Vec3b>(cvRound(points_(1, 57)) - 4, cvRound(points_(0, 57)));
  const cv::Vec3b is = drawn.at<cv::Vec3b>(cvRound(open(1, 57)) - 4, cvRound(open(0, 57)));
  EXPECT_LT(cv::norm(was, is), 60);
  EXPECT_EQ(drawn.at<cv::Vec3b>(3, 3), image_.at<cv::Vec3b>(3, 3));
  EXPECT_GT(cv::norm(drawn, image_, cv::NORM_INF), 20);
}

TEST_F(EditTest, RejectsInvalidPointsAndAmounts) {
  EXPECT_THROW((void)edited_points(model(), points_.leftCols(60), FaceEdit::kOpenMouth),
               std::invalid_argument);
  EXPECT_THROW((void)edited_points(model(), points_, FaceEdit::kOpenMouth, 3),
               std::invalid_argument);
  EXPECT_THROW((void)parse_edit("nose"), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::appearance
