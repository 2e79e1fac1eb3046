// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/detector.h"

#include "tarsier/face/detect/cascade.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/portrait.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace tarsier::face {
namespace {

constexpr const char* kImage = "/usr/share/doc/opencv-doc/examples/data/messi5.jpg";

class FaceTest : public testing::Test {
 protected:
  void SetUp() override {
    if (find_cascade("haarcascade_frontalface_alt2.xml").empty()) {
      GTEST_SKIP() << "opencv-data is not installed";
    }
    if (!std::filesystem::exists(kImage)) GTEST_SKIP() << "opencv-doc is not installed";
  }
};

TEST_F(FaceTest, DetectsFace) {
  FaceDetector detector({.max_width = 320});
  const std::vector<cv::Rect> faces = detector.detect(read_image(kImage));
  ASSERT_FALSE(faces.empty());
  EXPECT_TRUE(faces[0].contains(cv::Point(240, 115))) << faces[0];
}

TEST_F(FaceTest, TracksMovingFaceUnderOneId) {
  const synth::Portrait portrait = synth::render_portrait({320, 240});
  const cv::Point2d nose = portrait.truth.nose;
  FaceFollower follower;
  int id = 0;
  for (int i = 0; i < 12; ++i) {
    cv::Mat moved;
    const cv::Mat shift = (cv::Mat_<double>(2, 3) << 1, 0, 4 * i, 0, 1, 2 * i);
    cv::warpAffine(portrait.image, moved, shift, portrait.image.size(), cv::INTER_LINEAR,
                   cv::BORDER_REPLICATE);
    const auto& faces = follower.follow(moved);
    ASSERT_EQ(faces.size(), 1U) << "frame " << i;
    if (i == 0) id = faces[0].id;
    EXPECT_EQ(faces[0].id, id);
    const cv::Rect& box = faces[0].box;
    EXPECT_NEAR(box.x + box.width / 2.0, nose.x + 4 * i, 0.15 * box.width) << "frame " << i;
  }
}

TEST_F(FaceTest, DropsFaceAfterMissedFrames) {
  FaceFollower follower({}, {.search_every = 2, .forget_after = 3});
  ASSERT_FALSE(follower.follow(read_image(kImage)).empty());
  const cv::Mat nothing(342, 548, CV_8UC3, cv::Scalar(90, 90, 90));
  for (int i = 0; i < 3; ++i)
    EXPECT_FALSE(follower.follow(nothing).empty()) << "a short miss is bridged";
  EXPECT_TRUE(follower.follow(nothing).empty());
}

TEST(FaceDetector, TinyImagesHaveNoFaces) {
  if (find_cascade("haarcascade_frontalface_alt2.xml").empty()) {
    GTEST_SKIP() << "opencv-data is not installed";
  }
  FaceDetector detector;
  EXPECT_TRUE(detector.detect(cv::Mat(1, 1, CV_8UC3, cv::Scalar::all(0))).empty());
}

TEST(FaceDetector, RejectsOptionsOutOfRange) {
  EXPECT_THROW(FaceDetector({.min_face = 8}), std::invalid_argument);
  EXPECT_THROW(FaceDetector({.max_width = 20}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face
