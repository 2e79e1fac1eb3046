// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/sfm/two_view/focal_estimation.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

inline constexpr double kTrueFocal = 500;
inline constexpr double kThresholdPx = 1.5;

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
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 120; ++i) {
      const double depth = is_flat ? 5 : rng.uniform(3, 8);
      points.emplace_back(depth * rng.uniform(-0.4, 0.4), depth * rng.uniform(-0.3, 0.3), depth);
    }
    for (int i = 0; i < 6; ++i) {
      Image image;
      image.pose.rotation =
          geometry::rotation_by({0.05 * (i % 2), -0.06 * i + 0.02 * (i % 3), 0.1 * (i % 3)});
      image.pose.translation =
          -(image.pose.rotation * Eigen::Vector3d(0.3 * i, 0.2 * (i % 2), 0.25 * (i % 3)));
      for (const Eigen::Vector3d& point : points) {
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

}  // namespace tarsier::sfm
