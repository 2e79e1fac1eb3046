// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/search_plan.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tarsier::face {
namespace {

constexpr double kWindow = 16;
constexpr double kTile = 192;

// Whether some region of the plan covers a face of this box, with a quarter of its width around it.
bool is_covered(const SearchPlan& plan, const cv::Rect2d& box, cv::Size image) {
  const auto holds = [&](const SearchTile& tile) {
    if (box.width < tile.min_face) return false;
    if (tile.max_face > 0 && box.width > tile.max_face) return false;
    const double margin = box.width / 4;
    const cv::Rect2d around = cv::Rect2d(box.x - margin, box.y - margin, box.width + 2 * margin,
                                         box.height + 2 * margin) &
                              cv::Rect2d(0, 0, image.width, image.height);
    return (around & cv::Rect2d(tile.area)) == around;
  };
  return holds(plan.whole) || std::any_of(plan.tiles.begin(), plan.tiles.end(), holds);
}

TEST(SearchPlan, CoversFacesOfEverySizeEverywhere) {
  Rng rng(7);
  for (const cv::Size size :
       {cv::Size(320, 240), cv::Size(641, 479), cv::Size(1080, 1920), cv::Size(7680, 4320)}) {
    const SearchPlan plan = plan_search(size, 40, kWindow, kTile);
    for (int i = 0; i < 2000; ++i) {
      const double side = std::min(size.width, size.height);
      const double width = 40 * std::exp(rng.uniform() * std::log(side / 40));
      const double x = rng.uniform(0, size.width - width);
      const double y = rng.uniform(0, size.height - width);
      EXPECT_TRUE(is_covered(plan, {x, y, width, width}, size))
          << width << " px at " << x << "," << y << " of " << size;
    }
  }
}

TEST(SearchPlan, TileCostDoesNotDependOnImageSize) {
  for (const cv::Size size : {cv::Size(640, 480), cv::Size(1920, 1080), cv::Size(7680, 4320)}) {
    for (const double min_face : {24.0, 40.0, 100.0}) {
      const SearchPlan plan = plan_search(size, min_face, kWindow, kTile);
      const auto side = [&](const SearchTile& tile) {
        return std::max(tile.area.width, tile.area.height) * kWindow / tile.min_face;
      };
      EXPECT_LE(side(plan.whole), kTile + 1);
      for (const SearchTile& tile : plan.tiles) EXPECT_LE(side(tile), kTile + 1);
    }
  }
  // A second of a video.
  EXPECT_LE(plan_search({1920, 1080}, 40, kWindow, kTile).tiles.size(), 25U);
}

TEST(SearchPlan, SmallImagesNeedNoTiles) {
  const SearchPlan plan = plan_search({320, 240}, 40, kWindow, kTile);
  EXPECT_TRUE(plan.tiles.empty());
  EXPECT_EQ(plan.whole, (SearchTile{cv::Rect(0, 0, 320, 240), 40, 0}));
}

TEST(SearchPlan, RejectsInvalidSizes) {
  EXPECT_THROW((void)plan_search({0, 10}, 40, kWindow), std::invalid_argument);
  EXPECT_THROW((void)plan_search({10, 10}, 0, kWindow), std::invalid_argument);
  EXPECT_THROW((void)plan_search({10, 10}, 40, kWindow, 5 * kWindow), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face
