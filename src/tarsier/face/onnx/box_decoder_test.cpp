// SPDX-License-Identifier: MIT
#include "tarsier/face/onnx/box_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::face::onnx {
namespace {

using testing::ElementsAre;

// Cells of 8 px in 32 x 16 px: 4 x 2 of them.
struct Outputs {
  std::vector<std::string> names{"cls_8", "obj_8", "bbox_8", "kps_8"};
  std::vector<cv::Mat> mats;
  Outputs() {
    for (const int each : {1, 1, 4, 10}) mats.emplace_back(1, 8 * each, CV_32F, cv::Scalar(0));
  }
  void put(int cell, float cls, float obj) {
    mats[0].at<float>(cell) = cls;
    mats[1].at<float>(cell) = obj;
    mats[2].at<float>(4 * cell) = 0.5F;
    mats[2].at<float>(4 * cell + 1) = 0.25F;
    mats[2].at<float>(4 * cell + 2) = std::log(2.0F);
    mats[2].at<float>(4 * cell + 3) = std::log(3.0F);
    for (int k = 0; k < 10; ++k) mats[3].at<float>(10 * cell + k) = static_cast<float>(k) / 10;
  }
};

TEST(BoxDecoder, FindsStridesFromOutputNames) {
  EXPECT_THAT(strides_of(std::vector<std::string>{"obj_8", "cls_8", "kps_8", "bbox_8"}),
              ElementsAre(8));
  EXPECT_TRUE(strides_of(std::vector<std::string>{"cls_8", "obj_8", "bbox_8"}).empty());
  EXPECT_TRUE(strides_of(std::vector<std::string>{"numbers"}).empty());
}

TEST(BoxDecoder, DecodesTheFaceOfACell) {
  Outputs outputs;
  outputs.put(6, 0.8F, 0.8F);  // column 2, row 1
  const auto faces = decode_boxes(outputs.names, outputs.mats, {32, 16}, 0.5);
  ASSERT_EQ(faces.size(), 1U);
  EXPECT_NEAR(faces[0].score, 0.8, 1e-6);
  EXPECT_NEAR(faces[0].box.x + faces[0].box.width / 2, 20, 1e-5);
  EXPECT_NEAR(faces[0].box.y + faces[0].box.height / 2, 10, 1e-5);
  EXPECT_NEAR(faces[0].box.width, 16, 1e-5);
  EXPECT_NEAR(faces[0].box.height, 24, 1e-5);
  EXPECT_NEAR(faces[0].points[1].x, 17.6, 1e-5);
  EXPECT_NEAR(faces[0].points[1].y, 10.4, 1e-5);
}

TEST(BoxDecoder, SuppressesOverlappingFaces) {
  Outputs outputs;
  outputs.put(5, 1, 0.7F);
  outputs.put(6, 1, 0.9F);
  const auto faces = decode_boxes(outputs.names, outputs.mats, {32, 16}, 0.5);
  ASSERT_EQ(faces.size(), 1U);
  EXPECT_NEAR(faces[0].score, std::sqrt(0.9), 1e-6);
  EXPECT_EQ(decode_boxes(outputs.names, outputs.mats, {32, 16}, 0.5, 1.0).size(), 2U);
  EXPECT_TRUE(decode_boxes(outputs.names, outputs.mats, {32, 16}, 0.99).empty());
}

// Two boxes of no area: 0 / 0 is no overlap.
TEST(BoxDecoder, FacesWithoutAreaDoNotOverlap) {
  Outputs outputs;
  for (const int cell : {5, 6}) {
    outputs.put(cell, 1, 1);
    outputs.mats[2].at<float>(4 * cell + 2) = -1e4F;  // e^-10000
    outputs.mats[2].at<float>(4 * cell + 3) = -1e4F;
  }
  EXPECT_EQ(decode_boxes(outputs.names, outputs.mats, {32, 16}, 0.5, 0.0).size(), 2U);
}

TEST(BoxDecoder, IgnoresNonFiniteValues) {
  Outputs outputs;
  outputs.put(0, std::numeric_limits<float>::quiet_NaN(), 1);
  outputs.put(3, 1, 1);
  outputs.mats[2].at<float>(4 * 3 + 2) = 1e9F;  // e^1e9
  outputs.put(5, 1, 1);
  outputs.mats[3].at<float>(10 * 5) = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(decode_boxes(outputs.names, outputs.mats, {32, 16}, 0.5).empty());
}

TEST(BoxDecoder, RefusesOutputsOfOtherSizes) {
  Outputs outputs;
  EXPECT_THROW((void)decode_boxes(outputs.names, outputs.mats, {64, 16}, 0.5),
               std::invalid_argument);
  outputs.mats.pop_back();
  EXPECT_THROW((void)decode_boxes(outputs.names, outputs.mats, {32, 16}, 0.5),
               std::invalid_argument);
}

TEST(BoxDecoder, SquareSizeDoesNotDependOnYaw) {
  const std::array<cv::Point2d, 5> frontal{{{40, 50}, {80, 50}, {60, 72}, {44, 96}, {76, 96}}};
  const cv::Rect2d square = square_of_points(frontal);
  EXPECT_NEAR(square.width, 96, 1e-9);
  EXPECT_NEAR(square.x + square.width / 2, 60, 1e-9);
  std::array<cv::Point2d, 5> turned = frontal;
  for (cv::Point2d& point : turned) point.x = 60 + 0.4 * (point.x - 60);
  EXPECT_NEAR(square_of_points(turned).width, 96, 1);
}

}  // namespace
}  // namespace tarsier::face::onnx
