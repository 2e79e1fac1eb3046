// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/detect.h"

#include "tarsier/core/rng.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/draw_board.h"
#include "tarsier/planar/calibration/testing_camera.h"
#include "tarsier/synth/boards.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstdlib>
#include <filesystem>

namespace tarsier::planar::calibration {
namespace {

using geometry::Camera;
using ::testing::Contains;

// Root mean square distance from the exact points, which are identified by number. A whole board
// that looks the same upside down is compared in the better of its two orders.
double error_of(const BoardView& found, const BoardView& exact, bool may_be_turned) {
  double best = std::numeric_limits<double>::infinity();
  for (const bool turned : {false, true}) {
    if (turned && !may_be_turned) continue;
    double sum = 0;
    for (std::size_t i = 0; i < found.points.size(); ++i) {
      const auto last = static_cast<int>(exact.points.size()) - 1;
      const auto k = static_cast<std::size_t>(turned ? last - found.points[i] : found.points[i]);
      const cv::Point2d d = cv::Point2d(found.pixels[i]) - cv::Point2d(exact.pixels[k]);
      sum += d.dot(d);
    }
    best = std::min(best, std::sqrt(sum / static_cast<double>(found.points.size())));
  }
  return best;
}

class BoardsTest : public ::testing::TestWithParam<const char*> {};

TEST_P(BoardsTest, AreDetectedAccurately) {
  const BoardSpec spec = parse_board(GetParam(), 0.03);
  const Camera camera = phone();
  const synth::BoardRenderer renderer(camera, spec);
  int number = 0;
  for (const geometry::Rigid3& pose : synth::board_poses(camera, spec, 4, 31)) {
    synth::BoardAppearance appearance;
    appearance.seed = static_cast<std::uint64_t>(++number);
    appearance.clutter = 20;
    const cv::Mat image = renderer.render(pose, appearance);
    if (const char* folder = std::getenv("TARSIER_KEEP"))
      cv::imwrite(std::string(folder) + "/" + spec.text() + std::to_string(number) + ".png", image);
    const BoardView view = find_board(image, spec);
    ASSERT_FALSE(view.empty()) << number;
    if (spec.kind != BoardKind::kCharuco)
      ASSERT_EQ(view.points.size(), static_cast<std::size_t>(spec.points()));
    else
      EXPECT_GE(static_cast<int>(view.points.size()), spec.points() * 3 / 4) << number;
    // For dots, the centre of the imaged dot is not the image of its centre.
    const bool dots = spec.kind == BoardKind::kCircles || spec.kind == BoardKind::kCirclesGrid;
    EXPECT_LT(
        error_of(view, synth::exact_view(camera, pose, spec), spec.kind != BoardKind::kCharuco),
        dots ? 0.35 : 0.08)
        << number;
  }
}

INSTANTIATE_TEST_SUITE_P(All, BoardsTest,
                         ::testing::Values("chess:9x6", "charuco:7x5:5x5_100", "circles:4x11",
                                           "circles-grid:7x6"));

TEST(FindBoardTest, SearchesReducedImageAndRefinesInFullImage) {
  const BoardSpec spec = parse_board("chess:9x6", 0.03);
  Camera camera{2560, 1920, 2100, 2100, 1280, 960};
  const geometry::Rigid3 pose = synth::board_pose(camera, spec, {0.45, 0.55}, {25, 10, 5}, 0.6);
  synth::BoardAppearance appearance;
  appearance.blur_px = 1.2;
  const BoardView view = find_board(synth::render_board(camera, pose, spec, appearance), spec);
  ASSERT_FALSE(view.empty());
  EXPECT_LT(error_of(view, synth::exact_view(camera, pose, spec), true), 0.06);
}

TEST(FindBoardTest, ReturnsEmptyViewWithoutBoard) {
  const BoardSpec spec = parse_board("chess:9x6", 0.03);
  const Camera camera = phone();
  cv::Mat noise(480, 640, CV_8UC3);
  cv::RNG rng(5);
  rng.fill(noise, cv::RNG::UNIFORM, 0, 256);
  const BoardSpec other = parse_board("chess:6x4", 0.03);
  const cv::Mat wrong = synth::render_board(
      camera, synth::board_pose(camera, other, {0.5, 0.5}, {20, 10, 0}, 0.7), other);
  if (const char* folder = std::getenv("TARSIER_KEEP"))
    cv::imwrite(std::string(folder) + "/wrong.png", wrong);
  for (const char* text : {"chess:9x6", "charuco:7x5:5x5_100", "circles:4x11"}) {
    const BoardSpec searched = parse_board(text, 0.03);
    EXPECT_TRUE(find_board(noise, searched).empty()) << text;
    EXPECT_TRUE(find_board(wrong, searched).empty()) << text;
    EXPECT_TRUE(find_board(cv::Mat(480, 640, CV_8UC1, cv::Scalar(127)), searched).empty()) << text;
    EXPECT_TRUE(find_board(cv::Mat(16, 5000, CV_8UC1, cv::Scalar(0)), searched).empty()) << text;
  }
  EXPECT_THAT(other_chess_sizes(wrong, parse_board("chess:7x5", 0.03)), Contains("6x4"));
  EXPECT_TRUE(find_board(cv::Mat(3, 5, CV_8UC3, cv::Scalar::all(9)), spec).empty());
  EXPECT_TRUE(other_chess_sizes(cv::Mat(3, 5, CV_8UC3, cv::Scalar::all(9)), spec).empty());
  EXPECT_THROW((void)find_board(cv::Mat(), spec), std::invalid_argument);
  EXPECT_THROW((void)find_board(cv::Mat(480, 640, CV_16UC1), spec), std::invalid_argument);
}

TEST(FindBoardTest, ACharucoBoardMayBePartlyHidden) {
  const BoardSpec spec = parse_board("charuco:7x5:6x6_250", 0.03);
  const Camera camera = phone();
  const geometry::Rigid3 pose = synth::board_pose(camera, spec, {0.5, 0.5}, {25, 0, 0}, 0.9);
  cv::Mat image = synth::render_board(camera, pose, spec);
  cv::rectangle(image, {0, 0, 250, 480}, cv::Scalar(90, 90, 90), cv::FILLED);
  const BoardView view = find_board(image, spec);
  ASSERT_GE(view.points.size(), 8U);
  EXPECT_LT(view.points.size(), 24U);
  EXPECT_LT(error_of(view, synth::exact_view(camera, pose, spec), false), 0.08);
}

TEST(FindBoardTest, ToleratesUnevenAndDimLight) {
  const Camera camera = phone();
  for (const char* text :
       {"chess:9x6", "charuco:7x5:5x5_100", "circles:4x11", "circles-grid:7x6"}) {
    const BoardSpec spec = parse_board(text, 0.03);
    const synth::BoardRenderer renderer(camera, spec);
    const geometry::Rigid3 pose = synth::board_pose(camera, spec, {0.5, 0.5}, {20, -15, 5}, 0.8);
    synth::BoardAppearance shaded;
    shaded.fall_off = 0.8;
    EXPECT_FALSE(find_board(renderer.render(pose, shaded), spec).empty()) << text;
    synth::BoardAppearance dim;
    dim.paper = 60;
    dim.ink = 25;
    dim.noise = 2.5;
    EXPECT_FALSE(find_board(renderer.render(pose, dim), spec).empty()) << text;
  }
}

TEST(FindBoardTest, SharpnessFallsWithBlur) {
  const BoardSpec spec = parse_board("chess:9x6", 0.03);
  const Camera camera = phone();
  const geometry::Rigid3 pose = synth::board_pose(camera, spec, {0.5, 0.5}, {15, 10, 0}, 0.9);
  double last = 1;
  for (const double blur : {0.5, 1.0, 2.0, 3.0}) {
    synth::BoardAppearance appearance;
    appearance.blur_px = blur;
    const cv::Mat image = synth::render_board(camera, pose, spec, appearance);
    const double sharp = sharpness_of(image, synth::exact_view(camera, pose, spec), spec);
    EXPECT_LT(sharp, 0.85 * last) << blur;
    EXPECT_NEAR(sharp, std::min(1.0, std::erf(0.5 / (std::sqrt(2.0) * std::hypot(blur, 0.35)))),
                0.1)
        << blur;
    last = sharp;
  }
}

class RenderedTest : public ::testing::TestWithParam<const char*> {};

TEST_P(RenderedTest, CalibratesCameraFromImages) {
  const BoardSpec spec = parse_board(GetParam(), 0.03);
  const Camera truth = phone();
  const synth::BoardRenderer renderer(truth, spec);
  std::vector<BoardView> views;
  int number = 0;
  for (const geometry::Rigid3& pose : synth::board_poses(truth, spec, 9, 37)) {
    synth::BoardAppearance appearance;
    appearance.seed = static_cast<std::uint64_t>(++number);
    views.push_back(find_board(renderer.render(pose, appearance), spec));
    EXPECT_FALSE(views.back().empty()) << number;
  }
  const Calibration c = calibrate(views, spec, {640, 480});
  ASSERT_TRUE(c.ok()) << c.refusal;
  EXPECT_NEAR(c.camera.fx / truth.fx, 1, 2e-3);
  EXPECT_NEAR(c.camera.fy / truth.fy, 1, 2e-3);
  EXPECT_NEAR(c.camera.cx, truth.cx, 1.0);
  EXPECT_NEAR(c.camera.cy, truth.cy, 1.0);
  EXPECT_LT(c.camera.rms, 0.08);
  EXPECT_EQ(c.used, 9);
}

INSTANTIATE_TEST_SUITE_P(All, RenderedTest,
                         ::testing::Values("chess:9x6", "charuco:7x5:5x5_100", "circles:4x11",
                                           "circles-grid:7x6"));

// Wide lenses: the whole chain from images to the camera.
TEST(FindBoardTest, CalibratesFisheyeAndRationalLenses) {
  const Camera fisheye{
      640, 480, 245, 246, 322, 238, {0.03, -0.01, 2e-3, -5e-4}, 0, geometry::Lens::kFisheye};
  Camera rational = phone();
  rational.fx = rational.fy = 380;
  rational.lens = geometry::Lens::kRational;
  rational.distortion = {-0.2, 0.1, 5e-4, -1e-3, 0.02, 0.1, 0.05, 0.01};
  const BoardSpec spec = parse_board("charuco:9x7:5x5_100", 0.03);
  for (const Camera& truth : {fisheye, rational}) {
    std::vector<BoardView> views;
    int number = 0;
    const synth::BoardRenderer renderer(truth, spec);
    for (const geometry::Rigid3& pose : synth::board_poses(truth, spec, 12, 41)) {
      synth::BoardAppearance appearance;
      appearance.seed = static_cast<std::uint64_t>(++number);
      views.push_back(find_board(renderer.render(pose, appearance), spec));
    }
    CalibrateOptions options;
    options.lens = truth.lens;
    const Calibration c = calibrate(views, spec, {640, 480}, options);
    ASSERT_TRUE(c.ok()) << c.refusal;
    EXPECT_GE(c.used, 11);
    EXPECT_LT(c.camera.rms, 0.1);
    // The parameters of a rational lens are correlated. So the test compares rays.
    double worst = 0;
    for (int y = 48; y < 480; y += 48) {
      for (int x = 64; x < 640; x += 64) {
        const auto ray = truth.normalized_of(cv::Point2d(x, y));
        ASSERT_TRUE(ray);
        worst = std::max(worst, cv::norm(c.camera.pixel_of(*ray) - cv::Point2d(x, y)));
      }
    }
    EXPECT_LT(worst, 1.0) << name_of(truth.lens);
    EXPECT_NEAR(c.camera.fx / truth.fx, 1, 2e-3) << name_of(truth.lens);
  }
}

// The stereo pair of OpenCV's samples: 13 images of a 9x6 board for each camera.
TEST(FindBoardTest, DetectsBoardInOpenCvSampleImages) {
  TARSIER_LONG_TEST();
  const std::string folder = "/usr/share/doc/opencv-doc/examples/data/";
  if (!std::filesystem::exists(folder + "left01.jpg"))
    GTEST_SKIP() << "no " << folder << "left01.jpg (package opencv-doc)";
  const BoardSpec spec = parse_board("chess:9x6", 0.025);
  for (const char* side : {"left", "right"}) {
    std::vector<BoardView> views;
    for (int k = 1; k <= 14; k += 2) {
      const std::string path = folder + side + (k < 10 ? "0" : "") + std::to_string(k) + ".jpg";
      views.push_back(find_board(cv::imread(path), spec));
      EXPECT_FALSE(views.back().empty()) << path;
    }
    const Calibration c = calibrate(views, spec, {640, 480});
    ASSERT_TRUE(c.ok()) << c.refusal;
    EXPECT_EQ(c.used, 7) << side;
    EXPECT_LT(c.camera.rms, 0.41) << side;
    EXPECT_NEAR(c.camera.fx, 536, 5) << side;
  }
  // Part of the board is not found as a smaller board, nor is every other column.
  for (const char* name : {"left01.jpg", "right04.jpg"}) {
    const cv::Mat image = cv::imread(folder + name);
    for (const char* other : {"chess:8x6", "chess:9x5", "chess:10x6", "chess:8x5"})
      EXPECT_TRUE(find_board(image, parse_board(other, 0.025)).empty()) << name << " " << other;
  }
}

}  // namespace
}  // namespace tarsier::planar::calibration
