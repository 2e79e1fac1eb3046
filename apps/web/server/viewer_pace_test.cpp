// SPDX-License-Identifier: MIT
#include "viewer_pace.h"

#include <gtest/gtest.h>

namespace tarsier::web {
namespace {

// A line that takes so many bytes a second, and images of `best` bytes at the best quality.
int after_images(ViewerPace& pace, int images, double best, double bytes_per_s) {
  for (int i = 0; i < images; ++i) {
    const double size = best * (0.25 + 0.75 * pace.quality() / ViewerPace::kBest);
    pace.took(static_cast<std::size_t>(size), size / bytes_per_s, pace.quality());
  }
  return pace.quality();
}

TEST(ViewerPace, AQuickViewerHasTheBest) {
  ViewerPace pace;
  EXPECT_EQ(pace.quality(), ViewerPace::kBest);
  EXPECT_EQ(after_images(pace, 100, 60'000, 1e6), ViewerPace::kBest);
  pace.took(0, 0, ViewerPace::kBest);
  pace.took(60'000, 0, ViewerPace::kBest);
  pace.took(60'000, -1, ViewerPace::kBest);
  EXPECT_EQ(pace.quality(), ViewerPace::kBest);
}

TEST(ViewerPace, ASlowLineCarriesLessAndAQuickerOneMoreAgain) {
  ViewerPace pace;
  // 60 kB take 0.2 s.
  const int slower = after_images(pace, 20, 60'000, 300e3);
  EXPECT_LT(slower, ViewerPace::kBest);
  EXPECT_GT(slower, ViewerPace::kLeast);
  EXPECT_EQ(after_images(pace, 20, 60'000, 20e3), ViewerPace::kLeast);
  EXPECT_EQ(after_images(pace, 20, 60'000, 5e6), ViewerPace::kBest);
}

TEST(ViewerPace, StaysAtOneQualityOnASteadyLine) {
  for (const double rate : {100e3, 200e3, 300e3, 400e3, 450e3, 600e3, 700e3}) {
    ViewerPace pace;
    const int settled = after_images(pace, 30, 60'000, rate);
    for (int i = 0; i < 30; ++i) EXPECT_EQ(after_images(pace, 1, 60'000, rate), settled) << rate;
  }
}

TEST(ViewerPace, OneStallDoesNotLast) {
  ViewerPace pace;
  (void)after_images(pace, 20, 30'000, 1e6);
  pace.took(30'000, 2, pace.quality());
  EXPECT_EQ(pace.quality(), ViewerPace::kLeast);
  EXPECT_EQ(after_images(pace, 15, 30'000, 1e6), ViewerPace::kBest);
}

TEST(ViewerPace, ImagesMayBeBetterThanItAskedFor) {
  // Another viewer of the session has a quick line: all images are of the best quality.
  ViewerPace pace;
  for (int i = 0; i < 20; ++i) pace.took(60'000, 0.2, ViewerPace::kBest);
  const int quality = pace.quality();
  EXPECT_LT(quality, ViewerPace::kBest);
  for (int i = 0; i < 20; ++i) pace.took(60'000, 0.2, ViewerPace::kBest);
  EXPECT_EQ(pace.quality(), quality);
}

}  // namespace
}  // namespace tarsier::web
