// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/quad.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <limits>

namespace tarsier::plate {
namespace {

const Quad kSlanted{cv::Point2f{30, 20}, cv::Point2f{130, 35}, cv::Point2f{126, 70},
                    cv::Point2f{33, 48}};

TEST(Quad, MapBetweenMapsCornersToCorners) {
  const Quad box = quad_of({0, 0, 60, 20});
  const Quad mapped = transformed(map_between(kSlanted, box), kSlanted);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_LT(cv::norm(mapped[i] - box[i]), 1e-3);
}

TEST(Quad, DegenerateQuadsGiveTheIdentityAndAreNotConvex) {
  Quad line = kSlanted;
  line[2] = line[1];
  EXPECT_FALSE(is_convex(line, 1));
  EXPECT_EQ(map_between(line, kSlanted), cv::Matx33d::eye());
  Quad mirrored{kSlanted[1], kSlanted[0], kSlanted[3], kSlanted[2]};
  EXPECT_FALSE(is_convex(mirrored, 1));
  Quad broken = kSlanted;
  broken[3].x = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(is_convex(broken, 1));
  EXPECT_TRUE(is_convex(kSlanted, 1));
}

TEST(Quad, PartsFollowThePerspective) {
  const Quad whole = part_of(kSlanted, 0, 1, 0, 1);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_LT(cv::norm(whole[i] - kSlanted[i]), 1e-3);
  const Quad left = part_of(kSlanted, 0, 0.5F, 0, 1);
  const Quad right = part_of(kSlanted, 0.5F, 1, 0, 1);
  EXPECT_LT(cv::norm(left[1] - right[0]), 1e-3);
  EXPECT_LT(cv::norm(left[2] - right[3]), 1e-3);
}

TEST(Quad, GrowKeepsTheCentreAndScalesTheSides) {
  const Quad grown = grow(kSlanted, 1.5F, 1.0F);
  EXPECT_NEAR(mean_width(grown) / mean_width(kSlanted), 1.5, 0.05);
  EXPECT_NEAR(mean_height(grown) / mean_height(kSlanted), 1.0, 0.05);
}

TEST(Quad, OverlapOfBoxes) {
  const Quad a = quad_of({0, 0, 10, 10});
  EXPECT_FLOAT_EQ(box_iou(a, a), 1);
  EXPECT_FLOAT_EQ(box_iou(a, quad_of({5, 0, 10, 10})), 50.0F / 150.0F);
  EXPECT_FLOAT_EQ(box_iou(a, quad_of({20, 0, 10, 10})), 0);
  EXPECT_FLOAT_EQ(box_overlap_of_smaller(a, quad_of({5, 5, 2, 2})), 1);
  EXPECT_FLOAT_EQ(box_overlap_of_smaller(a, quad_of({5, 0, 10, 10})), 0.5F);
  const Quad point = quad_of({3, 3, 0, 0});
  EXPECT_EQ(box_iou(point, point), 0);
  EXPECT_EQ(box_overlap_of_smaller(a, point), 0);
}

// An image with a checkered plate at kSlanted, magnified `scale` times.
cv::Mat image_with_plate(double scale) {
  cv::Mat plate(40, 120, CV_8UC1);
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 120; ++x)
      plate.at<std::uint8_t>(y, x) = (x / 20 + y / 20) % 2 == 0 ? 220 : 40;
  Quad quad = kSlanted;
  for (cv::Point2f& p : quad) p *= scale;
  cv::Mat image(cvRound(100 * scale), cvRound(160 * scale), CV_8UC1, cv::Scalar(128));
  cv::warpPerspective(plate, image, cv::Mat(map_between(quad_of({0, 0, 119, 39}), quad)),
                      image.size(), cv::INTER_LINEAR, cv::BORDER_TRANSPARENT);
  return image;
}

class Sample : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Scales, Sample, testing::Values(1.0, 1.7, 4.0, 9.0));

TEST_P(Sample, RectifiesAPlateOfAnySize) {
  const double scale = GetParam();
  Quad quad = kSlanted;
  for (cv::Point2f& p : quad) p *= scale;
  const cv::Mat canvas = sample(image_with_plate(scale), quad, quad_of({0, 0, 119, 39}), {120, 40});
  ASSERT_EQ(canvas.size(), cv::Size(120, 40));
  for (int y = 10; y < 40; y += 20) {
    for (int x = 10; x < 120; x += 20) {
      const int expected = (x / 20 + y / 20) % 2 == 0 ? 220 : 40;
      EXPECT_NEAR(canvas.at<std::uint8_t>(y, x), expected, 30) << x << "," << y;
    }
  }
}

TEST(Sample, ReturnsACanvasForQuadsOutsideTheImage) {
  const cv::Mat image = image_with_plate(1);
  for (const cv::Rect2f box : {cv::Rect2f{-500, -500, 60, 20}, cv::Rect2f{150, 90, 60, 20},
                               cv::Rect2f{-1e6F, 0, 2e6F, 20}}) {
    const cv::Mat canvas = sample(image, quad_of(box), quad_of({0, 0, 59, 19}), {60, 20});
    EXPECT_EQ(canvas.size(), cv::Size(60, 20));
  }
}

}  // namespace
}  // namespace tarsier::plate
