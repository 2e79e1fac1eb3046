// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"
#include "tarsier/synth/observed_site.h"

#include <Eigen/LU>

#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm::test_support {

inline constexpr int kPrismImages = 72;
inline constexpr int kPrismSide = kPrismImages / 4;

// Computes the point nearest to the rays of a track; drops observations with errors above 3 px.
inline void triangulate(const Model& model, Point& point) {
  const geometry::Camera& camera = model.cameras[0];
  for (int round = 0; round < 3 && point.track.size() >= 2; ++round) {
    Eigen::Matrix3d sum = 1e-9 * Eigen::Matrix3d::Identity();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Observation& seen : point.track) {
      const Image& image = model.images[static_cast<std::size_t>(seen.image)];
      const cv::Point2d p = image.features[static_cast<std::size_t>(seen.feature)];
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
      const Image& image = model.images[static_cast<std::size_t>(seen.image)];
      const auto pixel = camera.project(image.pose * point.position);
      return !pixel ||
             cv::norm(*pixel -
                      cv::Point2d(image.features[static_cast<std::size_t>(seen.feature)])) > 3;
    });
  }
}

struct Prism {
  Model model;              // made from all its pairs
  std::vector<Pair> pairs;  // the pairs that agree with its poses
};

// A prism of four sides that are equal except for a fifth of their points. Folded: a quarter turn
// maps such a prism to itself, and all images are in front of one side; then pairs between the
// sides are included.
inline Prism prism(bool folded) {
  synth::SiteOptions options;
  options.kind = synth::SiteKind::kSymmetric;
  options.images = kPrismImages;
  const synth::ObservedSite site = synth::make_observed_site(options);
  Prism prism;
  Model& model = prism.model;
  model.cameras = {site.camera};
  std::vector<int> features;
  for (int i = 0; i < kPrismImages; ++i) {
    Image image;
    image.name = std::to_string(i);
    image.registered = true;
    image.features = site.features[static_cast<std::size_t>(i)];
    image.pose = site.poses[static_cast<std::size_t>(i)];
    if (folded) {
      const int side = i / kPrismSide;
      const double angle = -CV_PI / 2 * side;
      image.pose.rotation =
          image.pose.rotation * geometry::rotation_by(Eigen::Vector3d(0, 0, angle)).transpose();
    }
    features.push_back(static_cast<int>(image.features.size()));
    model.images.push_back(std::move(image));
  }
  for (const auto& known : site.pairs) {
    const int sides = std::abs(known.first / kPrismSide - known.second / kPrismSide);
    if (!folded && !known.same_place) continue;
    if (folded && known.same_place && sides != 0) continue;
    Pair pair;
    pair.first = known.first;
    pair.second = known.second;
    std::vector<Match> inliers;
    for (const auto& [first, second] : known.matches) {
      Point point;
      point.track = {{known.first, first}, {known.second, second}};
      triangulate(model, point);
      if (point.track.size() == 2) inliers.push_back({first, second});
    }
    pair.view.inliers = std::move(inliers);
    const geometry::Rigid3 between =
        model.images[static_cast<std::size_t>(pair.second)].pose *
        model.images[static_cast<std::size_t>(pair.first)].pose.inverse();
    pair.view.second_from_first = {between.rotation, between.translation.normalized()};
    pair.view.median_angle = 0.1;
    prism.pairs.push_back(std::move(pair));
  }
  for (std::vector<Observation>& track : make_tracks(prism.pairs, features)) {
    Point point;
    point.track = std::move(track);
    triangulate(model, point);
    if (point.track.size() >= 3) model.points.push_back(std::move(point));
  }
  return prism;
}

}  // namespace tarsier::sfm::test_support
