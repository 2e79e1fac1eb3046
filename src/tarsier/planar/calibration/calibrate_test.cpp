// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/calibrate.h"

#include "tarsier/core/rng.h"
#include "tarsier/planar/calibration/lens_fit.h"
#include "tarsier/planar/calibration/testing_camera.h"
#include "tarsier/synth/boards.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include <cmath>
#include <limits>

namespace tarsier::planar::calibration {
namespace {

using geometry::Camera;
using geometry::Lens;
using ::testing::HasSubstr;

const BoardSpec kChess = parse_board("chess:9x6", 0.025);

Camera wide() {
  return {640, 480, 250, 251, 318, 242, {0.03, -0.01, 2e-3, -5e-4}, 0, Lens::kFisheye};
}

std::vector<BoardView> seen_by(const Camera& camera, const std::vector<geometry::Rigid3>& poses,
                               double sigma, std::uint64_t seed, const BoardSpec& spec = kChess) {
  Rng rng(seed);
  std::vector<BoardView> views;
  for (const geometry::Rigid3& pose : poses) {
    BoardView view = synth::exact_view(camera, pose, spec);
    for (cv::Point2f& p : view.pixels) {
      p.x += static_cast<float>(rng.normal(0, sigma));
      p.y += static_cast<float>(rng.normal(0, sigma));
    }
    views.push_back(view);
  }
  return views;
}

// Largest distance between the pixels of two cameras for the same rays, over the image's middle 90
// %.
double difference(const Camera& a, const Camera& b) {
  double worst = 0;
  for (int y = 1; y < 20; ++y) {
    for (int x = 1; x < 20; ++x) {
      const auto ray = a.normalized_of({a.width * x / 20.0, a.height * y / 20.0});
      if (ray) worst = std::max(worst, cv::norm(b.pixel_of(*ray) - a.pixel_of(*ray)));
    }
  }
  return worst;
}

TEST(CalibrateTest, ExactCornersGiveTheExactCamera) {
  Camera rational = phone();
  rational.lens = Lens::kRational;
  rational.distortion = {-0.2, 0.1, 1e-3, -2e-3, 0.02, 0.1, 0.05, 0.01};
  for (const Camera& truth : {phone(), rational, wide()}) {
    CalibrateOptions options;
    options.lens = truth.lens;
    const Calibration c = calibrate(seen_by(truth, synth::board_poses(truth, kChess, 15, 3), 0, 1),
                                    kChess, {640, 480}, options);
    ASSERT_TRUE(c.ok()) << c.refusal;
    EXPECT_EQ(c.used, 15);
    EXPECT_LT(c.camera.rms, 1e-3) << name_of(truth.lens);  // float precision
    EXPECT_LT(difference(truth, c.camera), 0.05) << name_of(truth.lens);
    EXPECT_NEAR(c.camera.fx / truth.fx, 1, 1e-4) << name_of(truth.lens);
    EXPECT_EQ(c.camera.lens, truth.lens);
    EXPECT_EQ(c.camera.width, 640);
  }
}

TEST(CalibrateTest, RmsMatchesNoise) {
  for (const Camera& truth : {phone(), wide()}) {
    const double sigma = 0.2;
    CalibrateOptions options;
    options.lens = truth.lens;
    const auto poses = synth::board_poses(truth, kChess, 20, 5);
    const Calibration c = calibrate(seen_by(truth, poses, sigma, 7), kChess, {640, 480}, options);
    ASSERT_TRUE(c.ok()) << c.refusal;
    const double values = 2 * 20 * 54.0;
    const double freedom = values - parameter_count(truth) - 6 * 20;
    const double expected = sigma * std::sqrt(2 * freedom / values);
    EXPECT_NEAR(c.camera.rms / expected, 1, 0.04);  // 2160 values: 1.5 % is one deviation
    EXPECT_NEAR(c.camera.fx / truth.fx, 1, 2e-3);
    EXPECT_NEAR(c.camera.fy / truth.fy, 1, 2e-3);
    for (const ViewReport& view : c.views) EXPECT_EQ(view.state, ViewState::kUsed);
  }
}

// The reported deviations are right. Over many draws of the noise, the error divided by its
// deviation has a root mean square near 1.
TEST(CalibrateTest, DeviationsMatchActualErrors) {
  const Camera truth = phone();
  const auto poses = synth::board_poses(truth, kChess, 10, 5);
  double sum_fx = 0;
  double sum_cy = 0;
  double sum_k1 = 0;
  constexpr int kDraws = 24;
  for (int draw = 0; draw < kDraws; ++draw) {
    const Calibration c = calibrate(seen_by(truth, poses, 0.3, 100 + static_cast<unsigned>(draw)),
                                    kChess, {640, 480});
    ASSERT_TRUE(c.ok()) << c.refusal;
    sum_fx += std::pow((c.camera.fx - truth.fx) / c.deviations.fx, 2);
    sum_cy += std::pow((c.camera.cy - truth.cy) / c.deviations.cy, 2);
    sum_k1 +=
        std::pow((c.camera.distortion[0] - truth.distortion[0]) / c.deviations.distortion[0], 2);
  }
  // chi square of 24 degrees of freedom: 99.9 % lie between 0.37 and 2.1 per degree.
  for (const double sum : {sum_fx, sum_cy, sum_k1}) {
    EXPECT_GT(sum / kDraws, 0.37);
    EXPECT_LT(sum / kDraws, 2.1);
  }
}

TEST(CalibrateTest, IsNoWorseThanOpenCv) {
  const Camera truth = phone();
  const auto views = seen_by(truth, synth::board_poses(truth, kChess, 12, 9), 0.25, 11);
  const Calibration ours = calibrate(views, kChess, {640, 480});
  ASSERT_TRUE(ours.ok());
  std::vector<std::vector<cv::Point3f>> board(views.size());
  std::vector<std::vector<cv::Point2f>> pixels;
  for (std::size_t i = 0; i < views.size(); ++i) {
    pixels.push_back(views[i].pixels);
    for (const int p : views[i].points) {
      board[i].emplace_back(static_cast<float>(kChess.point(p).x),
                            static_cast<float>(kChess.point(p).y), 0.F);
    }
  }
  cv::Mat matrix;
  cv::Mat k;
  cv::Mat deviations;
  cv::Mat deviations_of_poses;
  cv::Mat errors;
  const double rms = cv::calibrateCamera(board, pixels, {640, 480}, matrix, k, cv::noArray(),
                                         cv::noArray(), deviations, deviations_of_poses, errors);
  EXPECT_NEAR(ours.camera.rms, rms, 1e-3);
  EXPECT_NEAR(ours.camera.fx, matrix.at<double>(0, 0), 0.1);
  // OpenCV 4.6 counts a point as one value instead of two, so its deviations are larger by this
  // ratio. OpenCV 4.10 counts as this library does.
  const double numbers = 9 + 6.0 * 12;
  const double ratio = std::sqrt((12 * 54 - numbers) / (2 * 12 * 54 - numbers));
  const auto as_counted =
      testing::AnyOf(testing::DoubleNear(1, 0.01), testing::DoubleNear(ratio, 0.01));
  EXPECT_THAT(ours.deviations.fx / deviations.at<double>(0), as_counted);
  EXPECT_THAT(ours.deviations.cy / deviations.at<double>(3), as_counted);
}

TEST(CalibrateTest, ExcludesOutlierViews) {
  const Camera truth = phone();
  auto views = seen_by(truth, synth::board_poses(truth, kChess, 14, 13), 0.15, 17);
  // A view of a bent board, and a view of another camera.
  for (cv::Point2f& p : views[3].pixels)
    p.x += 3 * std::sin(0.05F * p.y) + 2 * std::cos(0.04F * p.x);
  const Camera other{640, 480, 900, 900, 319.5, 239.5};
  views[7] = synth::exact_view(
      other, synth::board_pose(other, kChess, {0.3, 0.4}, {35, 20, 0}, 0.9), kChess);
  // And one with two wrong corners and all others right: it is kept, without them.
  std::swap(views[10].pixels[3], views[10].pixels[40]);
  const Calibration c = calibrate(views, kChess, {640, 480});
  ASSERT_TRUE(c.ok()) << c.refusal;
  EXPECT_EQ(c.used, 12);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const bool bad = i == 3 || i == 7;
    EXPECT_EQ(c.views[i].state, bad ? ViewState::kOutlier : ViewState::kUsed) << i;
    EXPECT_EQ(c.views[i].rms > 0.5, bad) << i;
    if (!bad) {
      EXPECT_EQ(c.views[i].dropped, i == 10 ? 2 : 0) << i;
    }
  }
  EXPECT_NEAR(c.camera.fx / truth.fx, 1, 3e-3);
}

TEST(CalibrateTest, AcceptsPartialBoards) {
  const BoardSpec charuco = parse_board("charuco:9x7:6x6_250", 0.03);
  const Camera truth = phone();
  auto views = seen_by(truth, synth::board_poses(truth, charuco, 12, 19), 0.1, 23, charuco);
  Rng rng(5);
  for (BoardView& view : views) {
    BoardView part;
    for (std::size_t i = 0; i < view.points.size(); ++i) {
      if (rng.uniform() < 0.4) continue;
      part.points.push_back(view.points[i]);
      part.pixels.push_back(view.pixels[i]);
    }
    view = part;
  }
  views.push_back({});
  const Calibration c = calibrate(views, charuco, {640, 480});
  ASSERT_TRUE(c.ok()) << c.refusal;
  EXPECT_EQ(c.used, 12);
  EXPECT_EQ(c.views.back().state, ViewState::kNoPose);
  EXPECT_NEAR(c.camera.fx / truth.fx, 1, 3e-3);
}

TEST(CalibrateTest, RejectsDegenerateViewsWithAdvice) {
  const Camera truth = phone();
  const auto poses = synth::board_poses(truth, kChess, 10, 29);
  const auto refusal = [&](const std::vector<BoardView>& views) {
    return calibrate(views, kChess, {640, 480}).refusal;
  };
  EXPECT_THAT(refusal({}), HasSubstr("0 views of the board: at least 3"));
  EXPECT_THAT(refusal(seen_by(truth, {poses[0]}, 0.1, 1)), HasSubstr("1 view of the board"));
  EXPECT_THAT(refusal(seen_by(truth, {poses[0], poses[1]}, 0.1, 1)), HasSubstr("at least 3"));
  EXPECT_THAT(refusal(seen_by(truth, std::vector(12, poses[0]), 0.1, 1)),
              HasSubstr("1 different views among the 12"));
  // Always frontal views, at different positions; with and without noise.
  for (const double sigma : {0.0, 0.2}) {
    std::vector<geometry::Rigid3> flat;
    for (const double x : {0.35, 0.5, 0.65})
      for (const double y : {0.4, 0.5, 0.6})
        flat.push_back(synth::board_pose(truth, kChess, {x, y}, {0, 0, 10 * x}, 0.7));
    EXPECT_THAT(refusal(seen_by(truth, flat, sigma, 1)), HasSubstr("tilt")) << sigma;
  }
}

TEST(CalibrateTest, InitialCameraDoesNotChangeResult) {
  const Camera truth = phone();
  const auto views = seen_by(truth, synth::board_poses(truth, kChess, 10, 31), 0.1, 3);
  const Calibration searched = calibrate(views, kChess, {640, 480});
  ASSERT_TRUE(searched.ok());
  CalibrateOptions options;
  Camera far = truth;
  far.fx = far.fy = 3000;
  for (const Camera& start : {searched.camera, far, wide()}) {
    options.start = start;
    const Calibration c = calibrate(views, kChess, {640, 480}, options);
    ASSERT_TRUE(c.ok()) << c.refusal;
    EXPECT_NEAR(c.camera.fx, searched.camera.fx, 1e-3);
    EXPECT_NEAR(c.camera.rms, searched.camera.rms, 1e-6);
  }
}

TEST(CalibrateTest, RejectsInvalidArguments) {
  EXPECT_THROW((void)calibrate({}, kChess, {0, 480}), std::invalid_argument);
  BoardView view;
  view.points = {0, 1};
  view.pixels = {{0, 0}};
  EXPECT_THROW((void)calibrate(std::vector<BoardView>(3, view), kChess, {640, 480}),
               std::invalid_argument);
  CalibrateOptions options;
  options.radial = 4;
  EXPECT_THROW((void)calibrate({}, kChess, {640, 480}, options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar::calibration
