// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_conflicts.h"

#include "tarsier/core/rng.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/synth/observed_site.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <string>

namespace tarsier::sfm {
namespace {

constexpr int kImages = 72;
constexpr int kSide = kImages / 4;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// The place nearest to the rays of a track; observations more than 3 px off go.
void triangulate(const Model& model, Point& point) {
  const geometry::Camera& camera = model.cameras[0];
  for (int round = 0; round < 3 && point.track.size() >= 2; ++round) {
    Eigen::Matrix3d sum = 1e-9 * Eigen::Matrix3d::Identity();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Observation& seen : point.track) {
      const Image& image = model.images[at(seen.image)];
      const cv::Point2d p = image.features[at(seen.feature)];
      const Eigen::Vector3d ray =
          (image.pose.rotation.transpose() *
           Eigen::Vector3d((p.x - camera.cx) / camera.fx, (p.y - camera.cy) / camera.fy, 1))
              .normalized();
      const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
      sum += across;
      right += across * image.pose.center();
    }
    point.position = sum.fullPivLu().solve(right);
    std::erase_if(point.track, [&](const Observation& seen) {
      const Image& image = model.images[at(seen.image)];
      const auto pixel = camera.project(image.pose * point.position);
      return !pixel || cv::norm(*pixel - cv::Point2d(image.features[at(seen.feature)])) > 3;
    });
  }
}

// A prism of four sides that are alike but for a fifth of their points. Folded: a quarter turn leaves such a prism as it
// is, and all images lie before one side; the matches of that geometry are those between the sides as well.
Model prism(bool folded) {
  synth::SiteOptions options;
  options.kind = synth::SiteKind::kSymmetric;
  options.images = kImages;
  const synth::ObservedSite site = synth::make_observed_site(options);
  Model model;
  model.cameras = {site.camera};
  std::vector<int> features;
  for (int i = 0; i < kImages; ++i) {
    Image image;
    image.name = std::to_string(i);
    image.registered = true;
    image.features = site.features[at(i)];
    image.pose = site.poses[at(i)];
    if (folded) {
      const double angle = -CV_PI / 2 * (i / kSide);
      image.pose.rotation =
          image.pose.rotation * geometry::rotation_by(Eigen::Vector3d(0, 0, angle)).transpose();
    }
    features.push_back(static_cast<int>(image.features.size()));
    model.images.push_back(std::move(image));
  }
  std::vector<Pair> pairs;
  for (const auto& known : site.pairs) {
    const int sides = std::abs(known.first / kSide - known.second / kSide);
    if (!folded && !known.same_place) continue;
    if (folded && known.same_place && sides != 0) continue;
    Pair pair;
    pair.first = known.first;
    pair.second = known.second;
    for (const auto& [first, second] : known.matches) {
      Point point;
      point.track = {{known.first, first}, {known.second, second}};
      triangulate(model, point);
      if (point.track.size() == 2) pair.view.inliers.push_back({first, second});
    }
    pairs.push_back(std::move(pair));
  }
  for (std::vector<Observation>& track : make_tracks(pairs, features)) {
    Point point;
    point.track = std::move(track);
    triangulate(model, point);
    if (point.track.size() >= 3) model.points.push_back(std::move(point));
  }
  return model;
}

TEST(ModelConflicts, ATrueModelHasNone) {
  const ModelConflicts conflicts(prism(false));
  EXPECT_FALSE(conflicts.any());
  for (int i = 0; i < kImages; ++i) EXPECT_FALSE(conflicts.are_different(i, (i + 2) % kImages));
}

// An arc of ten images, 4 degrees from one to the next. A third of the points are features of all, the others of the three
// images around one of them: images that are 12 degrees apart share none of those.
Model arc_of_weak_features() {
  constexpr int kArc = 10;
  Model model;
  model.cameras = {{.width = 640, .height = 480, .fx = 600, .fy = 600, .cx = 320, .cy = 240}};
  model.images.resize(kArc);
  for (int i = 0; i < kArc; ++i) {
    model.images[at(i)].registered = true;
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
      image.features.emplace_back(*model.cameras[0].project(image.pose * point.position));
      image.points.push_back(p);
      point.track.push_back({i, static_cast<int>(image.features.size()) - 1});
    }
    model.points.push_back(std::move(point));
  }
  return model;
}

TEST(ModelConflicts, FeaturesThatAreFoundFromNearbyOnlyAreNone) {
  const ModelConflicts conflicts(arc_of_weak_features());
  EXPECT_TRUE(conflicts.pairs().empty());
  EXPECT_FALSE(conflicts.any());
}

TEST(ModelConflicts, SidesThatLieOverEachOtherContradict) {
  const ModelConflicts conflicts(prism(true));
  EXPECT_TRUE(conflicts.any());
  EXPECT_GT(conflicts.pairs().size(), 100U);
  for (const auto& [first, second] : conflicts.pairs()) EXPECT_NE(first / kSide, second / kSide);
  int different = 0;
  for (int i = 0; i < kSide; ++i) {
    different += conflicts.are_different(i, i + kSide) ? 1 : 0;
    EXPECT_FALSE(conflicts.are_different(i, (i + 3) % kSide)) << i;
  }
  EXPECT_GE(different, kSide - 2);
  const auto evidence = conflicts.between(5, 5 + kSide);
  EXPECT_LT(evidence.found, 0.2 * evidence.expected);
  const std::vector<double>& shares = conflicts.shares();
  EXPECT_GT(std::accumulate(shares.begin(), shares.end(), 0.0), 0.3 * kImages);
}

}  // namespace
}  // namespace tarsier::sfm
