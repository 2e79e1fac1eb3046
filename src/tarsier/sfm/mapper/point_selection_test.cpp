// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/point_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr int kPoints = 3000;

// Of each three points, one is shown by images 0 and 1, one by 1 and 2, one by 2 and 3; image 4 shows ten.
Model chain() {
  Model model;
  model.images.resize(5);
  model.points.resize(kPoints);
  for (int p = 0; p < kPoints; ++p) {
    std::vector<Observation>& track = model.points[static_cast<std::size_t>(p)].track;
    track = {{p % 3, p}, {p % 3 + 1, p}};
    if (p % 300 == 0) track.push_back({4, p});
  }
  return model;
}

std::vector<int> shown(const Model& model, const std::vector<int>& points) {
  std::vector<int> count(model.images.size(), 0);
  for (const int p : points)
    for (const Observation& seen : model.points[static_cast<std::size_t>(p)].track)
      ++count[static_cast<std::size_t>(seen.image)];
  return count;
}

TEST(PointSelection, EachImageShowsEnoughOrAllItCan) {
  const Model model = chain();
  std::vector<int> all(kPoints);
  std::iota(all.begin(), all.end(), 0);
  const std::vector<int> chosen = select_points(model, all, {0, 1, 2, 3, 4}, 100);
  EXPECT_TRUE(std::is_sorted(chosen.begin(), chosen.end()));
  const std::vector<int> count = shown(model, chosen);
  for (int i = 0; i < 4; ++i) EXPECT_GE(count[static_cast<std::size_t>(i)], 100) << i;
  EXPECT_EQ(count[4], 10);
  EXPECT_LT(chosen.size(), 400U);
}

TEST(PointSelection, ImagesThatAreNotAskedForDoNotCount) {
  const Model model = chain();
  std::vector<int> all(kPoints);
  std::iota(all.begin(), all.end(), 0);
  const std::vector<int> count = shown(model, select_points(model, all, {0}, 100));
  EXPECT_EQ(count[0], 100);
  EXPECT_EQ(count[1], 100);
  EXPECT_EQ(count[3], 0);
}

TEST(PointSelection, WhatIsFewIsTakenWhole) {
  const Model model = chain();
  const std::vector<int> few{3, 4, 5, 6, 7};
  EXPECT_EQ(select_points(model, few, {0, 1, 2, 3}, 100), few);
}

}  // namespace
}  // namespace tarsier::sfm
