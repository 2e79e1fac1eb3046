// SPDX-License-Identifier: MIT
#include "tarsier/face/people/classical.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <map>
#include <string>

namespace tarsier::face::people {
namespace {

// Two dark disks for eyes and a bar for the mouth, at any position, size and rotation.
cv::Mat drawn_face(const Eyes& eyes, cv::Size size = {400, 300}) {
  cv::Mat image(size, CV_8UC1, cv::Scalar(180));
  const double d = eyes.distance();
  const cv::Point2d across = (eyes.right - eyes.left) * (1 / d);
  const cv::Point2d down(-across.y, across.x);
  for (const auto& eye : {eyes.left, eyes.right})
    cv::circle(image, cv::Point(cvRound(16 * eye.x), cvRound(16 * eye.y)), cvRound(16 * 0.12 * d),
               cv::Scalar(20), cv::FILLED, cv::LINE_AA, 4);
  const cv::Point2d mouth = 0.5 * (eyes.left + eyes.right) + 1.1 * d * down;
  cv::line(image, mouth - 0.3 * d * across, mouth + 0.3 * d * across, cv::Scalar(60),
           std::max(1, cvRound(0.1 * d)));
  return image;
}

cv::Point2d darkest(const cv::Mat& image, const cv::Rect& area) {
  const cv::Moments m = cv::moments(image(area) < 90, true);
  return {area.x + m.m10 / m.m00, area.y + m.m01 / m.m00};
}

class RecordingSink final : public DebugSink {
 public:
  void image(std::string_view name, const cv::Mat& image) override {
    images[std::string(name)] = image.clone();
  }
  std::map<std::string, cv::Mat> images;
};

TEST(CropFaceTest, PutsEyesAtFixedPositions) {
  const CropOptions options;
  for (const double degrees : {-25.0, 0.0, 17.0}) {
    for (const double distance : {24.0, 60.0, 110.0}) {
      const double a = degrees * CV_PI / 180;
      const cv::Point2d half(0.5 * distance * std::cos(a), 0.5 * distance * std::sin(a));
      const cv::Point2d middle(203.3, 110.7);
      const Eyes eyes{middle - half, middle + half};
      const cv::Mat face = crop_face(drawn_face(eyes), eyes, options);
      ASSERT_EQ(face.size(), options.size);
      const cv::Point2d left = darkest(face, {0, 30, 64, 50});
      const cv::Point2d right = darkest(face, {64, 30, 64, 50});
      EXPECT_NEAR(left.x, 0.27 * 128 - 0.5, 0.8) << degrees << " " << distance;
      EXPECT_NEAR(left.y, 0.34 * 160 - 0.5, 0.8);
      EXPECT_NEAR(right.x, 0.73 * 128 - 0.5, 0.8);
      EXPECT_NEAR(right.y, 0.34 * 160 - 0.5, 0.8);
    }
  }
}

TEST(CropFaceTest, ReplicatesTheImageBorder) {
  const Eyes eyes{{2, 5}, {30, 5}};
  const cv::Mat face = crop_face(cv::Mat(100, 40, CV_8UC1, cv::Scalar(77)), eyes);
  EXPECT_EQ(cv::countNonZero(face != 77), 0);
}

TEST(CropFaceTest, RejectsInvalidEyes) {
  const cv::Mat gray(50, 50, CV_8UC1, cv::Scalar(0));
  EXPECT_THROW((void)crop_face(gray, {{5, 5}, {5, 5}}), std::invalid_argument);
  EXPECT_THROW((void)crop_face(gray, {{NAN, 5}, {25, 5}}), std::invalid_argument);
}

TEST(EyesFromLandmarksTest, RecoversEyesAndKeepsScaleOfProfiles) {
  Eigen::Matrix2Xd points = Eigen::Matrix2Xd::Zero(2, 68);
  const auto put = [&](int first, int count, double x, double y) {
    for (int i = first; i < first + count; ++i) points.col(i) << 100 + 40 * x, 80 + 40 * y;
  };
  put(36, 6, -0.5, 0);
  put(42, 6, 0.5, 0);
  put(31, 5, 0, 0.70);
  put(50, 3, 0, 0.93);
  const Eyes eyes = eyes_from_landmarks(points);
  EXPECT_NEAR(eyes.left.x, 80, 1e-9);
  EXPECT_NEAR(eyes.right.x, 120, 1e-9);
  EXPECT_NEAR(eyes.left.y, 80, 1e-9);
  // In a profile view the eyes are closer together. The length of the face keeps the scale.
  put(36, 6, -0.3, 0);
  put(42, 6, 0.3, 0);
  EXPECT_GT(eyes_from_landmarks(points).distance(), 1.3 * 24);
}

TEST(ClassicalTest, ReportsAllStages) {
  const Eyes eyes{{150, 100}, {220, 112}};
  RecordingSink kept;
  const cv::Mat face = classical_face(drawn_face(eyes), eyes, {}, &kept);
  ASSERT_EQ(face.size(), cv::Size(70, 70));
  ASSERT_EQ(kept.images.size(), 4U);
  EXPECT_EQ(cv::norm(kept.images["masked"], face, cv::NORM_INF), 0);
  EXPECT_EQ(face.at<unsigned char>(69, 0), 128);                // outside the ellipse
  EXPECT_LT(kept.images["cut"].at<unsigned char>(10, 11), 40);  // an eye
}

TEST(ClassicalTest, CropAndImageGiveTheSameFace) {
  const Eyes eyes{{150, 100}, {206, 104}};
  const cv::Mat image = drawn_face(eyes);
  RecordingSink direct;
  RecordingSink through;
  (void)classical_face(image, eyes, {}, &direct);
  (void)classical_face(crop_face(image, eyes), CropOptions(), {}, &through);
  EXPECT_LT(face_difference(direct.images["cut"], through.images["cut"]), 0.15);
}

TEST(ClassicalTest, EqualizeHalvesReducesSideLight) {
  cv::Mat even(70, 70, CV_8UC1);
  cv::randu(even, 80, 180);
  cv::Mat shaded = even.clone();
  shaded.colRange(0, 35) *= 0.3;
  const double before = cv::norm(even, shaded, cv::NORM_L1) / static_cast<double>(even.total());
  const double after = cv::norm(equalize_halves(even), equalize_halves(shaded), cv::NORM_L1) /
                       static_cast<double>(even.total());
  EXPECT_GT(before, 35);
  EXPECT_LT(after, before / 3);
}

TEST(ClassicalTest, FaceDifferenceMatchesItsFormula) {
  const cv::Mat a(70, 70, CV_8UC1, cv::Scalar(100));
  EXPECT_EQ(face_difference(a, a), 0);
  EXPECT_NEAR(face_difference(a, a + 21), 0.3, 1e-9);
}

}  // namespace
}  // namespace tarsier::face::people
