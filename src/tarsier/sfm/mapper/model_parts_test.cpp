// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_parts.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace tarsier::sfm {
namespace {

// Images with one feature for each point; `shown` lists the images that observe each point.
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

TEST(ModelParts, DropsUnconnectedImages) {
  std::vector<std::vector<int>> shown(8, {2, 3, 4});
  shown.insert(shown.end(), 8, {0, 1});
  shown.push_back({1, 2});        // a single common point may be chance
  shown.push_back({1, 3, 4});     // only two images that observe it remain
  shown.push_back({1, 2, 3, 4});  // loses an observation
  Model model = model_of(5, shown);
  EXPECT_EQ(keep_largest_part(model), 2);
  for (int i = 0; i < 5; ++i)
    EXPECT_EQ(model.images[static_cast<std::size_t>(i)].registered, i >= 2) << i;
  ASSERT_EQ(model.points.size(), 9U);
  EXPECT_EQ(model.points[0].track.size(), 3U);
  EXPECT_EQ(model.points[8].track.size(), 3U);
  EXPECT_EQ(model.points[8].track[0].image, 2);
  EXPECT_TRUE(model.images[0].features.empty());
  // Images and points refer to each other consistently.
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
  EXPECT_EQ(shown_points, 8 * 3 + 3);
}

TEST(ModelParts, KeepsConnectedModel) {
  std::vector<std::vector<int>> shown(8, {0, 1, 2});
  shown.insert(shown.end(), 8, {1, 2, 3});
  shown.insert(shown.end(), 8, {0, 3});
  Model model = model_of(5, shown);  // the fifth is not registered
  EXPECT_EQ(keep_largest_part(model), 0);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(model.images[i].registered) << i;
  EXPECT_EQ(model.points[23].track.size(), 2U);
}

// The scale of each part relative to the other is free, about their common image.
TEST(ModelParts, SeparatesPartsWithOneCommonImage) {
  std::vector<std::vector<int>> shown(20, {2, 3, 4, 5});
  shown.insert(shown.end(), 20, {0, 1, 2});
  shown.insert(shown.end(), 20, {2, 3});
  shown.insert(shown.end(), 7, {1, 2, 3});  // one more would determine the scale
  Model model = model_of(6, shown);
  EXPECT_EQ(keep_largest_part(model), 2);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(model.images[i].registered, i >= 2) << i;

  shown.push_back({1, 2, 3});
  model = model_of(6, shown);
  EXPECT_EQ(keep_largest_part(model), 0);
}

}  // namespace
}  // namespace tarsier::sfm
