// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/point_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr int kPoints = 3000;

// Of each three points, one is observed by images 0 and 1, one by 1 and 2, one by 2 and 3. Image 4
// observes ten.
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

TEST(PointSelection, SelectsEnoughPointsPerImage) {
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

TEST(PointSelection, IgnoresOtherImages) {
  const Model model = chain();
  std::vector<int> all(kPoints);
  std::iota(all.begin(), all.end(), 0);
  const std::vector<int> count = shown(model, select_points(model, all, {0}, 100));
  EXPECT_EQ(count[0], 100);
  EXPECT_EQ(count[1], 100);
  EXPECT_EQ(count[3], 0);
}

TEST(PointSelection, SelectsAllOfFewPoints) {
  const Model model = chain();
  const std::vector<int> few{3, 4, 5, 6, 7};
  EXPECT_EQ(select_points(model, few, {0, 1, 2, 3}, 100), few);
}

// A point that images 0 to `images` - 1 observe.
Point point_of(int images) {
  Point point;
  for (int i = 0; i < images; ++i) point.track.push_back({i, 7});
  return point;
}

TEST(ChooseObservations, KeepsAllOfFew) {
  std::vector<Observation> chosen{{3, 3}};
  choose_observations(point_of(5), 0, std::vector<ImageRole>(5, ImageRole::kMoving), 5, chosen);
  EXPECT_EQ(chosen.size(), 5U);
  choose_observations(point_of(300), 0, std::vector<ImageRole>(300, ImageRole::kMoving), 0, chosen);
  EXPECT_EQ(chosen.size(), 300U);
}

TEST(ChooseObservations, SpreadsManyEvenlyOverTrackAndImages) {
  constexpr int kImages = 170;
  constexpr int kLimit = 40;
  std::vector<int> count(kImages, 0);
  std::vector<Observation> chosen;
  for (int p = 0; p < kPoints; ++p) {
    choose_observations(point_of(kImages), p, std::vector<ImageRole>(kImages, ImageRole::kMoving),
                        kLimit, chosen);
    ASSERT_EQ(chosen.size(), static_cast<std::size_t>(kLimit));
    for (std::size_t k = 1; k < chosen.size(); ++k) {
      const int gap = chosen[k].image - chosen[k - 1].image;
      ASSERT_GE(gap, kImages / kLimit);
      ASSERT_LE(gap, kImages / kLimit + 1);
    }
    for (const Observation& seen : chosen) ++count[static_cast<std::size_t>(seen.image)];
  }
  const double mean = 1.0 * kPoints * kLimit / kImages;
  EXPECT_GT(*std::min_element(count.begin(), count.end()), 0.9 * mean);
  EXPECT_LT(*std::max_element(count.begin(), count.end()), 1.1 * mean);
}

TEST(ChooseObservations, KeepsFewMovingImagesAndSomeFixedOnes) {
  std::vector<ImageRole> roles(100, ImageRole::kFixed);
  for (const int i : {20, 21, 22}) roles[static_cast<std::size_t>(i)] = ImageRole::kMoving;
  std::vector<Observation> chosen;
  choose_observations(point_of(100), 11, roles, 20, chosen);
  ASSERT_EQ(chosen.size(), 20U);
  EXPECT_EQ(std::count_if(chosen.begin(), chosen.end(),
                          [&](const Observation& seen) {
                            return roles[static_cast<std::size_t>(seen.image)] ==
                                   ImageRole::kMoving;
                          }),
            3);
  // If many images move, some observations of fixed images remain.
  std::fill(roles.begin() + 10, roles.end(), ImageRole::kMoving);
  choose_observations(point_of(100), 11, roles, 20, chosen);
  ASSERT_EQ(chosen.size(), 20U);
  EXPECT_EQ(std::count_if(chosen.begin(), chosen.end(),
                          [&](const Observation& seen) { return seen.image < 10; }),
            5);
}

std::vector<int> first_images(int count) {
  std::vector<int> images(static_cast<std::size_t>(count));
  std::iota(images.begin(), images.end(), 0);
  return images;
}

TEST(ChooseObservations, LocalImagesLieWithinSpan) {
  constexpr int kImages = 900;
  Model model;
  model.images.resize(kImages);
  // A track may have its images in any order.
  for (int p = 0; p < 9000; ++p) {
    model.points.push_back(point_of(kImages));
    std::vector<Observation>& track = model.points.back().track;
    std::rotate(track.begin(), track.begin() + p % kImages, track.end());
  }
  const std::vector<ImageRole> roles = image_roles(model, first_images(kImages), 40);
  EXPECT_EQ(std::count(roles.begin(), roles.end(), ImageRole::kAnchor), kMaxAnchors);
  std::vector<int> count(kImages, 0);
  std::vector<Observation> chosen;
  for (int p = 0; p < 9000; ++p) {
    choose_observations(model.points[static_cast<std::size_t>(p)], p, roles, 40, chosen);
    ASSERT_LE(chosen.size(), 40U);
    std::vector<int> local;
    for (const Observation& seen : chosen) {
      ++count[static_cast<std::size_t>(seen.image)];
      if (roles[static_cast<std::size_t>(seen.image)] == ImageRole::kLocal)
        local.push_back(seen.image);
    }
    ASSERT_GE(local.size(), 1U);
    const auto [first, last] = std::minmax_element(local.begin(), local.end());
    ASSERT_LE(*last - *first, kMaxLocalSpan);
  }
  EXPECT_GT(*std::min_element(count.begin(), count.end()), 9000 * 40 / kImages / 3);
}

TEST(ImageRoles, FewImagesHaveNoAnchors) {
  Model model;
  model.images.resize(400);
  model.points.push_back(point_of(400));
  std::vector<int> images(kMaxAnchors);
  std::iota(images.begin(), images.end(), 50);
  const std::vector<ImageRole> roles = image_roles(model, images, 40);
  EXPECT_EQ(roles[49], ImageRole::kFixed);
  EXPECT_EQ(std::count(roles.begin(), roles.end(), ImageRole::kMoving), kMaxAnchors);
}

TEST(ImageRoles, UnorderedImagesHaveNoAnchors) {
  Model model;
  model.images.resize(1000);
  for (int p = 0; p < 500; ++p) {
    Point point;
    for (int i = p; i < 1000; i += 97) point.track.push_back({i, p});
    model.points.push_back(point);
  }
  const std::vector<ImageRole> roles = image_roles(model, first_images(1000), 40);
  EXPECT_EQ(std::count(roles.begin(), roles.end(), ImageRole::kMoving), 1000);
}

TEST(PointSelection, IgnoresUnselectedObservations) {
  Model model;
  model.images.resize(100);
  for (int p = 0; p < 1000; ++p) model.points.push_back(point_of(100));
  std::vector<int> all(1000);
  std::iota(all.begin(), all.end(), 0);
  std::vector<int> images(100);
  std::iota(images.begin(), images.end(), 0);
  const std::size_t whole = select_points(model, all, images, 50).size();
  const std::size_t part = select_points(model, all, images, 50, 20).size();
  EXPECT_EQ(whole, 50U);
  EXPECT_GE(part, 250U);
  EXPECT_LE(part, 300U);
}

}  // namespace
}  // namespace tarsier::sfm
