// SPDX-License-Identifier: MIT
#include "tarsier/synth/boards.h"

#include "tarsier/core/rng.h"
#include "tarsier/geometry/rigid3.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>

namespace tarsier::synth {
namespace {

using planar::calibration::parse_board;

// Without blur and noise, the darkness of a dot equals its area, up to the sampling.
TEST(SynthBoardsTest, PixelsAreMeansOverTheirArea) {
  const auto spec = parse_board("circles-grid:3x3:0.5", 0.1);
  const geometry::Camera camera{200, 200, 200, 200, 99.5, 99.5};
  geometry::Rigid3 pose;
  pose.translation = {-0.1, -0.1, 1};  // 20 px a pitch, the middle dot in the image's middle
  BoardAppearance appearance;
  appearance.blur_px = 0;
  appearance.noise = 0;
  appearance.fall_off = 0;
  appearance.color = false;
  const cv::Mat image = render_board(camera, pose, spec, appearance);
  double dark = 0;
  cv::Point2d sum;
  for (int y = 90; y < 110; ++y) {
    for (int x = 90; x < 110; ++x) {
      const double d =
          (appearance.paper - image.at<uchar>(y, x)) / (appearance.paper - appearance.ink);
      dark += d;
      sum += d * cv::Point2d(x, y);
    }
  }
  EXPECT_NEAR(dark, CV_PI * 25, 0.3);  // px2: radius 5 px
  EXPECT_NEAR(sum.x / dark, 99.5, 0.01);
  EXPECT_NEAR(sum.y / dark, 99.5, 0.01);
}

// The renderer skips the samples of pixels with a uniform box, so none of these may differ.
TEST(SynthBoardsTest, UniformInkMatchesEachPoint) {
  for (const char* words :
       {"chess:9x6", "circles:4x11", "circles-grid:5x4:0.9", "charuco:5x7:6x6_250"}) {
    const BoardPrint print(parse_board(words, 0.025));
    const cv::Rect2d sheet = print.sheet();
    Rng rng(3);
    int decided = 0;
    int inked = 0;
    constexpr int kBoxes = 4000;
    for (int k = 0; k < kBoxes; ++k) {
      const cv::Rect2d box(rng.uniform(sheet.x, sheet.br().x), rng.uniform(sheet.y, sheet.br().y),
                           rng.uniform(0, 0.002), rng.uniform(0, 0.002));
      const auto ink = print.uniform_ink(box);
      if (!ink) continue;
      ++decided;
      inked += *ink ? 1 : 0;
      for (int i = 0; i < 20; ++i) {
        const cv::Point2d at(rng.uniform(box.x, box.br().x), rng.uniform(box.y, box.br().y));
        ASSERT_EQ(print.is_ink(at), *ink) << words << " at " << at << " of " << box;
      }
    }
    EXPECT_GT(decided, kBoxes * 7 / 10) << words;
    EXPECT_GT(inked, kBoxes / 20) << words;
  }
}

TEST(SynthBoardsTest, PosesShowWholeBoardAtRequestedPosition) {
  const auto spec = parse_board("chess:9x6", 0.025);
  const geometry::Camera camera{640, 480, 520, 520, 320, 240, {-0.3, 0.1, 0, 0, 0}};
  for (const geometry::Rigid3& pose : board_poses(camera, spec, 20, 1))
    EXPECT_EQ(exact_view(camera, pose, spec).points.size(), 54U);
  const auto view = exact_view(camera, board_pose(camera, spec, {0.4, 0.6}, {0, 0, 0}, 0.5), spec);
  cv::Point2f middle;
  for (const cv::Point2f& p : view.pixels) middle += p * (1.F / 54);
  EXPECT_NEAR(middle.x, 0.4 * 639, 4);
  EXPECT_NEAR(middle.y, 0.6 * 479, 4);
}

TEST(SynthBoardsTest, VideoAlternatesRestAndMotion) {
  const BoardVideo video({320, 240}, parse_board("chess:9x6", 0.025), 3);
  EXPECT_FALSE(video.pose_at(0.2));
  const auto first = video.pose_at(0.6);
  const auto still = video.pose_at(1.0);
  const auto moving = video.pose_at(1.4);
  const auto next = video.pose_at(1.8);
  ASSERT_TRUE(first && still && moving && next);
  EXPECT_EQ((first->translation - still->translation).norm(), 0);
  EXPECT_GT((first->translation - next->translation).norm(), 0.02);
  EXPECT_GT((moving->translation - first->translation).norm(), 1e-3);
  EXPECT_TRUE(geometry::is_rotation(moving->rotation, 1e-9));
  EXPECT_EQ(cv::norm(video.image_at(0.7), video.image_at(0.8), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(video.image_at(0.2), video.image_at(0.7), cv::NORM_INF), 50);
}

}  // namespace
}  // namespace tarsier::synth
