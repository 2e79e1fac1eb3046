// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/model_conflicts.h"

#include "tarsier/core/at.h"
#include "tarsier/core/rng.h"
#include "tarsier/sfm/consistency/testing_prism.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace tarsier::sfm {
namespace {

using Eigen::Vector3d;

Model registered_images(int count) {
  Model model;
  model.cameras = {{.width = 640, .height = 480, .fx = 600, .fy = 600, .cx = 320, .cy = 240}};
  model.images.resize(at(count));
  for (Image& image : model.images) image.registered = true;
  return model;
}

void observe(const cv::Point2d& pixel, int image_index, int point_index, Image& image,
             Point& point) {
  point.track.push_back({image_index, static_cast<int>(image.features.size())});
  image.features.emplace_back(pixel);
  image.points.push_back(point_index);
}

TEST(ModelConflicts, CorrectModelHasNone) {
  const ModelConflicts conflicts(test_support::prism(false).model);
  EXPECT_FALSE(conflicts.any());
  for (int i = 0; i < test_support::kPrismImages; ++i)
    EXPECT_FALSE(conflicts.are_different(i, (i + 2) % test_support::kPrismImages));
}

// An arc of ten images, 4 degrees apart. A third of the points are features of all images. Each
// other point is a feature of three neighbouring images, so images 12 degrees apart share none of
// these.
Model arc_of_weak_features() {
  constexpr int kArc = 10;
  Model model = registered_images(kArc);
  for (int i = 0; i < kArc; ++i) {
    model.images[at(i)].pose = {geometry::rotation_by({0, 4 * CV_PI / 180 * (i - 4.5), 0}),
                                {0, 0, 6}};
  }
  Rng rng(3);
  for (int p = 0; p < 300; ++p) {
    Point point;
    for (int k = 0; k < 3; ++k) point.position[k] = rng.uniform(-1.5, 1.5);
    for (int i = 0; i < kArc; ++i) {
      Image& image = model.images[at(i)];
      if (p % 3 != 0 && std::abs(p % kArc - i) > 1) continue;
      observe(*model.cameras[0].project(image.pose * point.position), i, p, image, point);
    }
    model.points.push_back(std::move(point));
  }
  return model;
}

TEST(ModelConflicts, IgnoreFeaturesDetectedFromNearbyOnly) {
  const ModelConflicts conflicts(arc_of_weak_features());
  EXPECT_TRUE(conflicts.pairs().empty());
  EXPECT_FALSE(conflicts.any());
}

// A row of 20 images, 1 apart, with points at distances 8 and 40. Three of four far points are
// weak: only the images within six of one image have them as features. Those of the last image are
// features of the images within four.
Model row_with_a_poor_image() {
  constexpr int kRow = 20;
  Model model = registered_images(kRow);
  for (int i = 0; i < kRow; ++i) {
    model.images[at(i)].pose.translation = {-1.0 * i, 0, 0};
  }
  Rng rng(5);
  for (int p = 0; p < 1000; ++p) {
    const bool is_far = p % 10 < 4;
    const bool is_weak = p % 10 < 3;
    const int center = p / 10 % kRow;
    const int max_distance = center == kRow - 1 ? 4 : 6;
    Point point;
    point.position = is_far ? Vector3d(rng.uniform(0, 20), rng.uniform(-15, 15), 40)
                            : Vector3d(rng.uniform(-4, 24), rng.uniform(-3, 3), 8);
    for (int i = 0; i < kRow; ++i) {
      Image& image = model.images[at(i)];
      const auto pixel = model.cameras[0].project(image.pose * point.position);
      if (std::abs(pixel->x - 320) > 320 || (is_weak && std::abs(center - i) > max_distance))
        continue;
      if (is_weak && i == kRow - 1 && center != i) continue;
      observe(*pixel, i, p, image, point);
    }
    model.points.push_back(std::move(point));
  }
  return model;
}

TEST(ModelConflicts, IgnoreImageThatContradictsDistantOnesOnly) {
  const ModelConflicts conflicts(row_with_a_poor_image());
  EXPECT_GE(conflicts.pairs().size(), 3U);
  for (const auto& [first, second] : conflicts.pairs()) EXPECT_EQ(second, 19) << first;
  EXPECT_TRUE(conflicts.any(true));
  EXPECT_FALSE(conflicts.any());
}

// A row of images in front of a wall with randomly detected points. Most points are detected in two
// of three images, the others at a lower rate.
struct RandomRow {
  int images = 500;
  double step = 0.5;  // between images, at a distance of 5
  int points = 10000;
  double weak_rate = 0.33;
  int unsharp_every = 1000;  // such images have half the weak points
};

Model random_row(const RandomRow& row) {
  Model model = registered_images(row.images);
  for (int i = 0; i < row.images; ++i) {
    model.images[at(i)].pose.translation = {-row.step * i, 0, 5};
  }
  Rng rng(2);
  for (int p = 0; p < row.points; ++p) {
    Point point;
    point.position.x() = rng.uniform(0, row.step * row.images);
    point.position.y() = rng.uniform(-1.5, 1.5);
    const bool is_weak = p % 3 == 0;
    for (int i = 0; i < row.images; ++i) {
      Image& image = model.images[at(i)];
      if (std::abs(point.position.x() - row.step * i) > 3) continue;
      const auto pixel = model.cameras[0].project(image.pose * point.position);
      const bool is_unsharp = i % row.unsharp_every == row.unsharp_every - 1;
      const double rate = is_weak ? row.weak_rate * (is_unsharp ? 0.5 : 1) : 0.66;
      if (!pixel || std::abs(pixel->x - 320) > 320 || rng.uniform(0, 1) > rate) continue;
      observe(*pixel, i, p, image, point);
    }
    model.points.push_back(std::move(point));
  }
  return model;
}

TEST(ModelConflicts, IgnoreScatteredContradictions) {
  const ModelConflicts conflicts(random_row({}));
  EXPECT_GE(conflicts.pairs().size(), 5U);
  EXPECT_FALSE(conflicts.any());
  EXPECT_TRUE(conflicts.any(true));  // unless places are known to look alike
}

// On average eight images or fewer should observe each point. By chance, some images have few of
// the points that are rare only because of them.
TEST(ModelConflicts, IgnorePointsThatAreRareForOneImage) {
  const ModelConflicts conflicts(
      random_row({.images = 100, .step = 0.5, .points = 2000, .weak_rate = 0.4}));
  EXPECT_TRUE(conflicts.pairs().empty());
  EXPECT_FALSE(conflicts.any(true));
}

// Some images contradict many neighbours, but all images of two places never contradict each other.
TEST(ModelConflicts, IgnoreContradictionsOfDenseRow) {
  const ModelConflicts conflicts(random_row(
      {.images = 400, .step = 0.02, .points = 700, .weak_rate = 0.2, .unsharp_every = 20}));
  EXPECT_GE(conflicts.pairs().size(), 20U);
  EXPECT_FALSE(conflicts.any());
}

TEST(ModelConflicts, FindSuperimposedSides) {
  const ModelConflicts conflicts(test_support::prism(true).model);
  EXPECT_TRUE(conflicts.any());
  EXPECT_GT(conflicts.pairs().size(), 100U);
  for (const auto& [first, second] : conflicts.pairs())
    EXPECT_NE(first / test_support::kPrismSide, second / test_support::kPrismSide);
  int different = 0;
  for (int i = 0; i < test_support::kPrismSide; ++i) {
    different += conflicts.are_different(i, i + test_support::kPrismSide) ? 1 : 0;
    EXPECT_FALSE(conflicts.are_different(i, (i + 3) % test_support::kPrismSide)) << i;
  }
  EXPECT_GE(different, test_support::kPrismSide - 2);
  const auto evidence = conflicts.between(5, 5 + test_support::kPrismSide);
  EXPECT_LT(evidence.found, 0.2 * evidence.expected);
  const std::vector<double>& shares = conflicts.shares();
  EXPECT_GT(std::accumulate(shares.begin(), shares.end(), 0.0), 0.3 * test_support::kPrismImages);
}

}  // namespace
}  // namespace tarsier::sfm
