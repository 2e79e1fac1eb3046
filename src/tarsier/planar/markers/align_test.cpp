// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/align.h"

#include "tarsier/planar/markers/testing_marker.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::planar::markers {
namespace {

struct Scene {
  cv::Mat gray;
  const Dictionary& family = find_dictionary("36h11");
  DrawnMarker truth{17, square(80, 60, 26, 25, 0.1)};

  explicit Scene(double blur = 0.8, double ground = 180)
      : gray(120, 160, CV_8UC1, cv::Scalar(ground)) {
    draw_marker(gray, family, truth);
    cv::GaussianBlur(gray, gray, {}, blur);
  }
  [[nodiscard]] std::optional<Alignment> align(double shift) const {
    Quad start = truth.corners;
    for (std::size_t k = 0; k < 4; ++k)
      start[k] += shift * Eigen::Vector2d(std::sin(1.0 + static_cast<double>(k)),
                                          std::cos(3.0 * static_cast<double>(k)));
    return align_marker(gray, family.code(truth.id), family.cells(), start, {.iterations = 8});
  }
};

TEST(Align, EstimatesCornersAndBlur) {
  for (const double blur : {0.5, 1.0, 1.8}) {
    const Scene scene(blur, 220);
    const auto aligned = scene.align(0.8);
    ASSERT_TRUE(aligned) << blur;
    // A constant blur in the image differs slightly between the cells of a tilted marker.
    EXPECT_LT(rmse(aligned->corners, scene.truth.corners), 0.035 * (1 + blur)) << blur;
    EXPECT_GT(aligned->correlation, 0.99) << blur;
    // A pixel's own area adds blur, 1 / 12 px^2; interpolation adds blur too.
    EXPECT_NEAR(aligned->blur_px, std::sqrt(blur * blur + 0.2), 0.2) << blur;
  }
}

TEST(Align, AcceptsOneCellOfMargin) {
  const Scene scene(1, 60);
  const auto aligned = scene.align(0.8);
  ASSERT_TRUE(aligned);
  EXPECT_LT(rmse(aligned->corners, scene.truth.corners), 0.12);
}

// e^T M e / 8 with errors e and the reported information M has the mean 1 for an exact covariance.
// The mean of 100 trials has a standard deviation of sqrt(2 / 8 / 100) = 0.05. The covariance
// includes a tenth of a pixel for errors of the model itself, so here the mean is below 1. At low
// noise these errors hardly occur; at high noise they nearly reach it (the noise alone would give
// 2). The bounds are 5 standard deviations from the measured mean. So a covariance twice or half as
// large fails.
TEST(Align, InformationMatchesCornerErrors) {
  struct Case {
    double noise;
    double mean;
  };
  for (const Case& given : {Case{12, 0.17}, Case{40, 0.90}}) {
    double mean = 0;
    constexpr int kTrials = 100;
    for (int trial = 0; trial < kTrials; ++trial) {
      Scene scene;
      add_noise(scene.gray, given.noise, 100 + static_cast<std::uint64_t>(trial));
      const auto aligned = scene.align(0.4);
      ASSERT_TRUE(aligned);
      Eigen::Matrix<double, 8, 1> error;
      for (std::size_t k = 0; k < 4; ++k)
        error.segment<2>(static_cast<Eigen::Index>(2 * k)) =
            aligned->corners[k] - scene.truth.corners[k];
      const Eigen::Map<const Eigen::Matrix<double, 8, 8>> information(aligned->information.data());
      mean += error.dot(information * error) / 8 / kTrials;
    }
    EXPECT_NEAR(mean, given.mean, 5 * 0.05 * given.mean) << given.noise;
  }
}

TEST(Align, IsRobustToOcclusion) {
  Scene scene;
  cv::circle(scene.gray, {72, 70}, 5, cv::Scalar(150), cv::FILLED);
  const auto aligned = scene.align(0.4);
  ASSERT_TRUE(aligned);
  EXPECT_LT(rmse(aligned->corners, scene.truth.corners), 0.15);
}

TEST(Align, HasLowCorrelationForAnotherMarker) {
  const Scene scene;
  const auto right = align_marker(scene.gray, scene.family.code(17), 6, scene.truth.corners, {});
  const auto wrong = align_marker(scene.gray, scene.family.code(18), 6, scene.truth.corners, {});
  ASSERT_TRUE(right);
  EXPECT_GT(right->correlation, 0.98);
  EXPECT_TRUE(!wrong || wrong->correlation < 0.6);
}

TEST(Align, ReturnsNothingOutsideImage) {
  const Scene scene;
  EXPECT_FALSE(align_marker(scene.gray, scene.family.code(17), 6, square(400, 300, 26, 0), {}));
}

}  // namespace
}  // namespace tarsier::planar::markers
