// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_parts.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace tarsier::sfm {
namespace {

// Images of one feature a point; each point is shown by the images named.
Model model_of(int images, const std::vector<std::vector<int>>& shown_by) {
  Model model;
  model.images.resize(static_cast<std::size_t>(images));
  for (const std::vector<int>& track : shown_by) {
    Point point;
    for (const int i : track) {
      Image& image = model.images[static_cast<std::size_t>(i)];
      image.registered = true;
      point.track.push_back({i, static_cast<int>(image.features.size())});
      image.features.emplace_back(1.F, 2.F);
      image.points.push_back(static_cast<int>(model.points.size()));
    }
    model.points.push_back(point);
  }
  return model;
}

TEST(ModelParts, ImagesThatShareNothingWithTheOthersAreLeftOut) {
  std::vector<std::vector<int>> shown(8, {2, 3});
  shown.insert(shown.end(), 8, {0, 1});
  shown.insert(shown.end(), 8, {3, 4});
  shown.push_back({1, 2});        // one common point is chance
  shown.push_back({1, 3, 4});     // two that show it are left
  shown.push_back({1, 2, 3, 4});  // loses an observation
  Model model = model_of(5, shown);
  EXPECT_EQ(keep_largest_part(model), 2);
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(model.images[static_cast<std::size_t>(i)].registered, i >= 2) << i;
  ASSERT_EQ(model.points.size(), 17U);
  EXPECT_EQ(model.points[0].track.size(), 2U);
  EXPECT_EQ(model.points[16].track.size(), 3U);
  EXPECT_EQ(model.points[16].track[0].image, 2);
  EXPECT_TRUE(model.images[0].features.empty());
  // Images and points refer to each other.
  int shown_points = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const Image& image = model.images[i];
    for (std::size_t f = 0; f < image.points.size(); ++f) {
      if (image.points[f] < 0) continue;
      ++shown_points;
      const auto& track = model.points[static_cast<std::size_t>(image.points[f])].track;
      const Observation expected{static_cast<int>(i), static_cast<int>(f)};
      EXPECT_NE(std::find(track.begin(), track.end(), expected), track.end());
    }
  }
  EXPECT_EQ(shown_points, 16 * 2 + 3);
}

TEST(ModelParts, OneThatHangsTogetherStays) {
  std::vector<std::vector<int>> shown(8, {0, 1});
  shown.insert(shown.end(), 8, {1, 2});
  Model model = model_of(4, shown);  // the fourth is not registered
  EXPECT_EQ(keep_largest_part(model), 0);
  EXPECT_TRUE(model.images[0].registered && model.images[1].registered &&
              model.images[2].registered);
  EXPECT_EQ(model.points[15].track.size(), 2U);
}

}  // namespace
}  // namespace tarsier::sfm
