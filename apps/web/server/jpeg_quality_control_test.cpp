// SPDX-License-Identifier: MIT
#include "jpeg_quality_control.h"

#include <gtest/gtest.h>

namespace tarsier::web {
namespace {

// A line that takes so many bytes a second, and images of `best` bytes at the best quality.
int after_images(JpegQualityControl& quality_control, int images, double best, double bytes_per_s) {
  for (int i = 0; i < images; ++i) {
    const double size =
        best * (0.25 + 0.75 * quality_control.quality() / JpegQualityControl::kMaxQuality);
    quality_control.add_transfer(static_cast<std::size_t>(size), size / bytes_per_s,
                                 quality_control.quality());
  }
  return quality_control.quality();
}

TEST(JpegQualityControl, AFastViewerGetsTheMaximum) {
  JpegQualityControl quality_control;
  EXPECT_EQ(quality_control.quality(), JpegQualityControl::kMaxQuality);
  EXPECT_EQ(after_images(quality_control, 100, 60'000, 1e6), JpegQualityControl::kMaxQuality);
  quality_control.add_transfer(0, 0, JpegQualityControl::kMaxQuality);
  quality_control.add_transfer(60'000, 0, JpegQualityControl::kMaxQuality);
  quality_control.add_transfer(60'000, -1, JpegQualityControl::kMaxQuality);
  EXPECT_EQ(quality_control.quality(), JpegQualityControl::kMaxQuality);
}

TEST(JpegQualityControl, FollowsTheBandwidth) {
  JpegQualityControl quality_control;
  // 60 kB take 0.2 s.
  const int slower = after_images(quality_control, 20, 60'000, 300e3);
  EXPECT_LT(slower, JpegQualityControl::kMaxQuality);
  EXPECT_GT(slower, JpegQualityControl::kMinQuality);
  EXPECT_EQ(after_images(quality_control, 20, 60'000, 20e3), JpegQualityControl::kMinQuality);
  EXPECT_EQ(after_images(quality_control, 20, 60'000, 5e6), JpegQualityControl::kMaxQuality);
}

TEST(JpegQualityControl, DoesNotOscillateAtConstantBandwidth) {
  for (const double rate : {100e3, 200e3, 300e3, 400e3, 450e3, 600e3, 700e3}) {
    JpegQualityControl quality_control;
    const int settled = after_images(quality_control, 30, 60'000, rate);
    for (int i = 0; i < 30; ++i)
      EXPECT_EQ(after_images(quality_control, 1, 60'000, rate), settled) << rate;
  }
}

TEST(JpegQualityControl, RecoversFromAStall) {
  JpegQualityControl quality_control;
  (void)after_images(quality_control, 20, 30'000, 1e6);
  quality_control.add_transfer(30'000, 2, quality_control.quality());
  EXPECT_EQ(quality_control.quality(), JpegQualityControl::kMinQuality);
  EXPECT_EQ(after_images(quality_control, 15, 30'000, 1e6), JpegQualityControl::kMaxQuality);
}

TEST(JpegQualityControl, AllowsForImagesAboveTheRequestedQuality) {
  // Another viewer of the session has a quick line: all images are of the best quality.
  JpegQualityControl quality_control;
  for (int i = 0; i < 20; ++i)
    quality_control.add_transfer(60'000, 0.2, JpegQualityControl::kMaxQuality);
  const int quality = quality_control.quality();
  EXPECT_LT(quality, JpegQualityControl::kMaxQuality);
  for (int i = 0; i < 20; ++i)
    quality_control.add_transfer(60'000, 0.2, JpegQualityControl::kMaxQuality);
  EXPECT_EQ(quality_control.quality(), quality);
}

}  // namespace
}  // namespace tarsier::web
