// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <optional>
#include <vector>

// Initialisation of train_head: rigid factorisation of a symmetric object.
namespace tarsier::face::head {

struct ScaledOrthography {
  double scale = 1;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  // camera_from_object
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();
};

struct Factorization {
  Eigen::Matrix3Xd shape;  // 3 x n, symmetric about x = 0, centred on 0
  std::vector<ScaledOrthography> cameras;
};

// Factorises faces (2 x n each, of similar size, complete) as s R shape + t. The mean head has
// pitch 0, and the rim of the shape is behind its middle. The latter resolves the reflection in
// depth, which scaled orthography cannot. Empty if the views do not determine depth.
[[nodiscard]] std::optional<Factorization> factorize_symmetric(
    const std::vector<Eigen::Matrix2Xd>& faces, const std::vector<int>& mirror);

}  // namespace tarsier::face::head
