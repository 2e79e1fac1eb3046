// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/atlas.h"

#include "tarsier/core/rng.h"
#include "tarsier/sfm/surface/seam_levelling.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace tarsier::sfm {
namespace {

TEST(Pack, RectanglesAreInsideAndDisjoint) {
  Rng rng(3);
  std::vector<cv::Size> sizes;
  int area = 0;
  while (area < 256 * 256 * 8 / 10) {
    sizes.emplace_back(rng.integer(1, 40), rng.integer(1, 40));
    area += sizes.back().area();
  }
  const auto corners = pack(sizes, 256);
  ASSERT_TRUE(corners.has_value());
  cv::Mat1b covered(256, 256, static_cast<unsigned char>(0));
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const cv::Rect rect((*corners)[i], sizes[i]);
    ASSERT_EQ(rect & cv::Rect(0, 0, 256, 256), rect);
    EXPECT_EQ(cv::countNonZero(covered(rect)), 0);
    covered(rect) = 1;
  }
}

TEST(Pack, ReportsThatTheyDoNotFit) {
  EXPECT_FALSE(pack({{10, 10}, {10, 10}}, 14).has_value());
  EXPECT_FALSE(pack({{20, 1}}, 14).has_value());
  EXPECT_TRUE(pack({}, 14).has_value());
  EXPECT_TRUE(pack({{14, 14}}, 14).has_value());
}

TEST(LevelSeams, MakesBothSidesEqual) {
  // Two strips of ten nodes, side by side along ten seams; the second is 20 brighter.
  SeamProblem problem;
  problem.nodes = 20;
  for (int i = 0; i < 10; ++i) {
    if (i > 0) problem.edges.emplace_back(i - 1, i);
    if (i > 0) problem.edges.emplace_back(10 + i - 1, 10 + i);
    problem.seams.push_back({i, 10 + i, cv::Vec3f(20, 10, 0)});
  }
  const std::vector<cv::Vec3f> offsets = level_seams(problem);
  for (std::size_t i = 0; i < 10; ++i) {
    EXPECT_NEAR(offsets[i][0], 10, 0.05);
    EXPECT_NEAR(offsets[10 + i][0], -10, 0.05);
    EXPECT_NEAR(offsets[i][1], 5, 0.05);
    EXPECT_NEAR(offsets[i][2], 0, 1e-6);
  }
}

TEST(LevelSeams, KeepsTexturesWithoutSeamsUnchanged) {
  SeamProblem problem;
  problem.nodes = 2;
  problem.edges = {{0, 1}};
  EXPECT_EQ(level_seams(problem)[1], cv::Vec3f(0, 0, 0));
}

}  // namespace
}  // namespace tarsier::sfm
