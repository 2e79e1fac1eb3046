// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/piecewise_warp.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>

namespace tarsier::face::shape {
namespace {

using Eigen::Matrix2Xd;

// A frame of 40 x 30 whose corners are points, and some points in it.
Matrix2Xd whole_frame() {
  Matrix2Xd points(2, 7);
  points << 0, 39, 39, 0, 20, 11.5, 30, 0, 0, 29, 29, 14.2, 20, 8;
  return points;
}

PiecewiseWarp whole_warp() {
  const Matrix2Xd points = whole_frame();
  return {points, delaunay(points), cv::Size(40, 30)};
}

cv::Mat smooth_image(cv::Size size, int type) {
  cv::Mat image(size, type);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      for (int c = 0; c < image.channels(); ++c) {
        image.ptr<std::uint8_t>(y)[x * image.channels() + c] = static_cast<std::uint8_t>(
            128 + 60 * std::sin(x * 0.06 + c) + 50 * std::cos(y * 0.08 - c));
      }
    }
  }
  return image;
}

TEST(PiecewiseWarp, PixelsLieInTheirTriangles) {
  Matrix2Xd points(2, 5);
  points << 5, 33.5, 25, 8.3, 18, 3, 6.5, 25, 22, 14;
  const PiecewiseWarp warp(points, delaunay(points), {40, 30});
  ASSERT_FALSE(warp.pixels().empty());
  double area = 0;
  for (const auto& [a, b, c] : warp.mesh()) {
    const Eigen::Vector2d u = points.col(b) - points.col(a);
    const Eigen::Vector2d v = points.col(c) - points.col(a);
    area += (u.x() * v.y() - u.y() * v.x()) / 2;
  }
  EXPECT_NEAR(static_cast<double>(warp.pixels().size()), area, 0.05 * area);
  EXPECT_EQ(cv::countNonZero(warp.mask()), static_cast<int>(warp.pixels().size()));
  int last = -1;
  for (const PiecewiseWarp::Pixel& pixel : warp.pixels()) {
    EXPECT_EQ(warp.mask().at<std::uint8_t>(pixel.y, pixel.x), 255);
    EXPECT_GT(pixel.y * 40 + pixel.x, last);  // row by row, each once
    last = pixel.y * 40 + pixel.x;
    Eigen::Vector2d at(0, 0);
    const Triangle& triangle = warp.mesh()[static_cast<std::size_t>(pixel.triangle)];
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_GE(pixel.weight[k], -1e-6F);
      at += static_cast<double>(pixel.weight[k]) * points.col(triangle[k]);
    }
    EXPECT_LT((at - Eigen::Vector2d(pixel.x, pixel.y)).norm(), 1e-4);
  }
}

TEST(PiecewiseWarp, CoversTheFrameToItsEdges) {
  EXPECT_EQ(whole_warp().pixels().size(), 40U * 30U);  // no gap between triangles either
}

TEST(PiecewiseWarp, IdentityChangesNothing) {
  const PiecewiseWarp warp = whole_warp();
  for (const int type : {CV_8UC1, CV_8UC3}) {
    const cv::Mat image = smooth_image({40, 30}, type);
    EXPECT_EQ(cv::norm(warp.to_frame(image, whole_frame()), image, cv::NORM_INF), 0);
    cv::Mat back = cv::Mat::zeros(image.size(), type);
    warp.from_frame(image, whole_frame(), back);
    EXPECT_EQ(cv::norm(back, image, cv::NORM_INF), 0);
  }
}

TEST(PiecewiseWarp, AffineMapsAreExact) {
  const PiecewiseWarp warp = whole_warp();
  // Bilinear sampling reproduces a ramp exactly.
  cv::Mat ramp(200, 300, CV_32FC2);
  for (int y = 0; y < ramp.rows; ++y)
    for (int x = 0; x < ramp.cols; ++x)
      ramp.at<cv::Vec2f>(y, x) = cv::Vec2f(static_cast<float>(x), static_cast<float>(y));
  Eigen::Matrix2d linear;
  linear << 2.1, -1.3, 0.7, 3.2;
  const Eigen::Vector2d shift(90, 20);
  const Matrix2Xd points = (linear * whole_frame()).colwise() + shift;
  std::vector<float> out;
  EXPECT_EQ(warp.sample(ramp, points, out), 1.0);
  ASSERT_EQ(out.size(), 2 * warp.pixels().size());
  for (std::size_t k = 0; k < warp.pixels().size(); ++k) {
    const PiecewiseWarp::Pixel& pixel = warp.pixels()[k];
    const Eigen::Vector2d truth = linear * Eigen::Vector2d(pixel.x, pixel.y) + shift;
    EXPECT_NEAR(out[k], truth.x(), 1e-3);
    EXPECT_NEAR(out[warp.pixels().size() + k], truth.y(), 1e-3);
  }
}

TEST(PiecewiseWarp, MapsFramePointsToImagePoints) {
  // Not affine: each point of the frame on a pixel shows the value at its own position in the
  // image.
  const PiecewiseWarp warp = whole_warp();
  Matrix2Xd points = whole_frame() * 3;
  points.col(4) << 71.25, 30.5;
  cv::Mat ramp(100, 130, CV_32FC1);
  for (int y = 0; y < ramp.rows; ++y)
    for (int x = 0; x < ramp.cols; ++x)
      ramp.at<float>(y, x) = static_cast<float>(x) + 1000 * static_cast<float>(y);
  std::vector<float> out;
  (void)warp.sample(ramp, points, out);
  EXPECT_NEAR(out[0], 0, 1e-2);
  EXPECT_NEAR(out[39], 117, 1e-2);
  EXPECT_NEAR(out[29 * 40 + 39], 117 + 87000, 1e-1);
  // (30, 8) is point 6, which does not move.
  EXPECT_NEAR(out[8 * 40 + 30], 90 + 24000, 1e-1);
}

TEST(PiecewiseWarp, RoundTripIsNearlyTheImage) {
  Rng rng(1);
  for (const int type : {CV_8UC1, CV_8UC3}) {
    const cv::Mat image = smooth_image({160, 120}, type);
    Matrix2Xd points = whole_frame() * 2.5;
    points.colwise() += Eigen::Vector2d(20.3, 15.6);
    for (Eigen::Index i = 4; i < 7; ++i)
      points.col(i) += Eigen::Vector2d(rng.uniform(-5, 5), rng.uniform(-5, 5));
    const PiecewiseWarp warp(whole_frame() * 2, delaunay(whole_frame()), {80, 60});
    const cv::Mat texture = warp.to_frame(image, points);
    cv::Mat back = cv::Mat::zeros(image.size(), type);
    warp.from_frame(texture, points, back);
    int drawn = 0;
    double worst = 0;
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const bool is_inside = x >= 21 && x <= 117 && y >= 16 && y <= 88;  // of the outline
        const int channels = image.channels();
        const std::uint8_t* a = image.ptr<std::uint8_t>(y) + x * channels;
        const std::uint8_t* b = back.ptr<std::uint8_t>(y) + x * channels;
        if (is_inside) {
          ++drawn;
          for (int c = 0; c < channels; ++c) worst = std::max(worst, std::abs(a[c] - b[c]) * 1.0);
        } else if (x < 20 || y < 15 || x > 118 || y > 89) {
          EXPECT_EQ(b[0], 0) << x << " " << y;  // nothing is drawn outside
        }
      }
    }
    EXPECT_EQ(drawn, 97 * 73);
    EXPECT_LE(worst, 4);
  }
}

TEST(PiecewiseWarp, ReplicatesTheBorderOutsideTheImage) {
  const PiecewiseWarp warp = whole_warp();
  const cv::Mat image = smooth_image({40, 30}, CV_8UC1);
  Matrix2Xd points = whole_frame();
  points.row(0).array() += 20;
  std::vector<float> out;
  EXPECT_NEAR(warp.sample(image, points, out), 0.5, 1e-9);
  for (int y = 0; y < 30; ++y) {
    const auto row = static_cast<std::size_t>(y) * 40;
    EXPECT_EQ(out[row + 19], static_cast<float>(image.at<std::uint8_t>(y, 39)));
    EXPECT_EQ(out[row + 39], static_cast<float>(image.at<std::uint8_t>(y, 39)));
  }
  // Far outside, and in images of one pixel.
  EXPECT_EQ(warp.sample(image, (points * 1000).array() + 5000, out), 0);
  const cv::Mat one(1, 1, CV_8UC3, cv::Scalar(1, 2, 3));
  (void)warp.sample(one, points, out);
  EXPECT_EQ(out.front(), 1);
  EXPECT_EQ(out.back(), 3);
}

TEST(PiecewiseWarp, LaterTrianglesCoverEarlierOnes) {
  Matrix2Xd frame(2, 4);
  frame << 0, 9, 9, 0, 0, 0, 9, 9;
  const std::vector<Triangle> mesh{{0, 1, 2}, {0, 2, 3}};
  const PiecewiseWarp warp(frame, mesh, {10, 10});
  cv::Mat texture(10, 10, CV_8UC1);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 10; ++x)
      texture.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(x > y ? 50 : 200);
  // Point 3 is folded over onto point 1: the second triangle covers the first.
  Matrix2Xd points = frame * 4;
  points.col(3) = points.col(1);
  cv::Mat image = cv::Mat::zeros(40, 40, CV_8UC1);
  warp.from_frame(texture, points, image);
  EXPECT_EQ(image.at<std::uint8_t>(5, 25), 200);
  EXPECT_EQ(image.at<std::uint8_t>(25, 5), 0);
  // Triangles without area are not drawn.
  cv::Mat untouched = cv::Mat::zeros(40, 40, CV_8UC1);
  warp.from_frame(texture, Matrix2Xd::Constant(2, 4, 20), untouched);
  EXPECT_EQ(cv::countNonZero(untouched), 0);
}

TEST(PiecewiseWarp, RejectsInvalidInput) {
  const Matrix2Xd points = whole_frame();
  const auto mesh = delaunay(points);
  EXPECT_THROW(PiecewiseWarp(points, {}, {40, 30}), std::invalid_argument);
  EXPECT_THROW(PiecewiseWarp(points, mesh, {0, 30}), std::invalid_argument);
  EXPECT_THROW(PiecewiseWarp(points, {{0, 1, 7}}, {40, 30}), std::invalid_argument);
  EXPECT_THROW(PiecewiseWarp(points, {{1, 0, 2}}, {40, 30}), std::invalid_argument);
  const PiecewiseWarp warp = whole_warp();
  const cv::Mat image(30, 40, CV_8UC1, cv::Scalar(7));
  std::vector<float> out;
  Matrix2Xd bad = points;
  bad(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)warp.sample(image, bad, out), std::invalid_argument);
  EXPECT_THROW((void)warp.sample(image, points.leftCols(6), out), std::invalid_argument);
  EXPECT_THROW((void)warp.sample(cv::Mat(), points, out), std::invalid_argument);
  EXPECT_THROW((void)warp.sample(cv::Mat(4, 4, CV_16UC1), points, out), std::invalid_argument);
  EXPECT_THROW((void)warp.to_frame(cv::Mat(4, 4, CV_32FC1), points), std::invalid_argument);
  cv::Mat target(10, 10, CV_8UC3);
  EXPECT_THROW(warp.from_frame(image, points, target), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::shape
