// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/focal_estimation.h"

#include "tarsier/core/rng.h"
#include "tarsier/sfm/mapper/image_features.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <vector>

namespace tarsier::sfm {
namespace {

using Eigen::Vector3d;

constexpr double kTrueFocal = 500;
constexpr double kThresholdPx = 1.5;

// Six images of the same points, all pairs verified. The given focal length is wrong.
struct CameraPath {
  std::vector<geometry::Camera> cameras;
  std::vector<Image> images;
  std::vector<Pair> pairs;

  explicit CameraPath(double known_focal, bool is_flat = false) {
    const geometry::Camera lens{
        .width = 640, .height = 480, .fx = kTrueFocal, .fy = kTrueFocal, .cx = 320, .cy = 240};
    cameras = {lens};
    cameras[0].fx = cameras[0].fy = known_focal;
    Rng rng(1);
    std::vector<Vector3d> points;
    for (int i = 0; i < 120; ++i) {
      const double depth = is_flat ? 5 : rng.uniform(3, 8);
      points.emplace_back(depth * rng.uniform(-0.4, 0.4), depth * rng.uniform(-0.3, 0.3), depth);
    }
    for (int i = 0; i < 6; ++i) {
      Image image;
      image.pose.rotation =
          geometry::rotation_by({0.05 * (i % 2), -0.06 * i + 0.02 * (i % 3), 0.1 * (i % 3)});
      image.pose.translation =
          -(image.pose.rotation * Vector3d(0.3 * i, 0.2 * (i % 2), 0.25 * (i % 3)));
      for (const Vector3d& point : points) {
        const cv::Point2d pixel = *lens.project(image.pose * point);
        image.features.emplace_back(static_cast<float>(pixel.x + rng.normal(0, 0.3)),
                                    static_cast<float>(pixel.y + rng.normal(0, 0.3)));
      }
      images.push_back(image);
    }
    for (int i = 0; i < 6; ++i) {
      for (int j = i + 1; j < 6; ++j) {
        Pair pair;
        pair.first = i;
        pair.second = j;
        std::vector<Match> all;
        for (int k = 0; k < 120; ++k) all.push_back({k, k});
        pair.matches = 120;
        pair.view = verify_pair(images[static_cast<std::size_t>(i)].features,
                                images[static_cast<std::size_t>(j)].features, all, cameras[0],
                                cameras[0], {.known_focal = false});
        pairs.push_back(pair);
      }
    }
  }

  [[nodiscard]] std::vector<FocalEstimate> estimate() const {
    return estimate_focal_lengths(cameras, std::vector<char>(cameras.size(), 1), images, pairs,
                                  kThresholdPx, {});
  }
};

TEST(FocalEstimation, FindsTheFocalLengthFromPairs) {
  for (const double known : {250.0, 800.0, 1200.0}) {
    const std::vector<FocalEstimate> found = CameraPath(known).estimate();
    ASSERT_EQ(found.size(), 1U) << known;
    EXPECT_NEAR(found[0].focal_px, kTrueFocal, 0.04 * kTrueFocal) << known;
    EXPECT_EQ(found[0].pairs, 15);
  }
}

TEST(FocalEstimation, IsTheSameForAnyNumberOfThreads) {
  const CameraPath scene(800);
  cv::setNumThreads(1);
  const std::vector<FocalEstimate> one = scene.estimate();
  cv::setNumThreads(3);
  const std::vector<FocalEstimate> three = scene.estimate();
  cv::setNumThreads(-1);
  ASSERT_EQ(one.size(), 1U);
  ASSERT_EQ(three.size(), 1U);
  EXPECT_EQ(one[0].focal_px, three[0].focal_px);
}

TEST(FocalEstimation, SkipsKnownLens) {
  const CameraPath scene(800);
  EXPECT_TRUE(
      estimate_focal_lengths(scene.cameras, {0}, scene.images, scene.pairs, kThresholdPx, {})
          .empty());
}

TEST(FocalEstimation, IsEmptyForPlanarScene) {
  EXPECT_TRUE(CameraPath(800, true).estimate().empty());
}

TEST(FocalEstimation, IsEmptyForFewPairs) {
  CameraPath scene(800);
  scene.pairs.resize(4);
  EXPECT_TRUE(scene.estimate().empty());
}

// Images 0 to 2 have a known lens, the others an unknown one.
TEST(FocalEstimation, UsesPairsWithAKnownLens) {
  CameraPath scene(800);
  scene.cameras.push_back(scene.cameras[0]);
  scene.cameras[0].fx = scene.cameras[0].fy = kTrueFocal;
  for (std::size_t i = 3; i < 6; ++i) scene.images[i].camera = 1;
  const std::vector<FocalEstimate> found =
      estimate_focal_lengths(scene.cameras, {0, 1}, scene.images, scene.pairs, kThresholdPx, {});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].camera, 1);
  EXPECT_EQ(found[0].pairs, 12);  // all pairs except those of the known lens alone
  EXPECT_NEAR(found[0].focal_px, kTrueFocal, 0.04 * kTrueFocal);
}

// Each image has its own camera. No camera has five pairs of its own, but all pairs together give
// the factor.
TEST(FocalEstimation, CamerasWithFewPairsTakeCommonFactor) {
  CameraPath scene(800);
  scene.cameras.resize(6, scene.cameras[0]);
  for (int i = 0; i < 6; ++i) scene.images[static_cast<std::size_t>(i)].camera = i;
  const std::vector<FocalEstimate> found = scene.estimate();
  ASSERT_EQ(found.size(), 6U);
  for (const FocalEstimate& each : found) EXPECT_NEAR(each.focal_px, kTrueFocal, 0.04 * kTrueFocal);
}

TEST(FocalEstimation, MotionIsCorrectWithKnownFocalLength) {
  CameraPath scene(800);
  const Pair& pair = scene.pairs[3];  // of images 0 and 4
  const geometry::Rigid3 truth = scene.images[4].pose * scene.images[0].pose.inverse();
  const auto rotation_error = [&](const TwoView& view) {
    return geometry::angle_of(truth.rotation * view.second_from_first.rotation.transpose());
  };
  TwoView view = pair.view;
  const geometry::Camera right{
      .width = 640, .height = 480, .fx = kTrueFocal, .fy = kTrueFocal, .cx = 320, .cy = 240};
  estimate_motion_again(scene.images[0].features, scene.images[4].features, right, right, {}, view);
  EXPECT_EQ(view.inliers, pair.view.inliers);
  EXPECT_LT(rotation_error(view), 0.01);
  EXPECT_GT(rotation_error(pair.view), 5 * rotation_error(view));
  EXPECT_GT(view.second_from_first.translation.dot(truth.translation.normalized()), 0.999);
}

// A model gives another focal length.
TEST(FocalEstimation, AdoptsFocalLengthOfModel) {
  CameraPath scene(800);
  ImageSet images{PipelineOptions()};
  for (const Image& image : scene.images) {
    ImageFeatures features;
    features.size = {640, 480};
    features.lens = {scene.cameras[0], "guess"};
    features.features.points = image.features;
    images.add(features, "image");
  }
  Model model;
  model.cameras = scene.cameras;
  model.images = scene.images;
  for (Image& image : model.images) image.registered = true;
  std::vector<Pair> pairs = scene.pairs;
  EXPECT_TRUE(images.adopt_focal_lengths({model}, 0.15, pairs, {}).empty());  // the same
  EXPECT_FALSE(images.is_estimated(0));
  model.cameras[0].fx = model.cameras[0].fy = kTrueFocal;
  EXPECT_EQ(images.adopt_focal_lengths({model}, 0.15, pairs, {}).size(), 1U);
  EXPECT_TRUE(images.is_estimated(0));
  EXPECT_EQ(images.cameras()[0].fx, kTrueFocal);
  for (const Pair& pair : pairs) {
    const geometry::Rigid3 truth =
        scene.images[static_cast<std::size_t>(pair.second)].pose *
        scene.images[static_cast<std::size_t>(pair.first)].pose.inverse();
    EXPECT_LT(geometry::angle_of(truth.rotation * pair.view.second_from_first.rotation.transpose()),
              0.02);
  }
}

}  // namespace
}  // namespace tarsier::sfm
