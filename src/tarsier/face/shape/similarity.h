// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

namespace tarsier::face::shape {

// x' = a x - b y + tx, y' = b x + a y + ty: rotation by atan2(b, a), scale hypot(a, b).
struct Similarity2d {
  double a = 1;
  double b = 0;
  double tx = 0;
  double ty = 0;

  [[nodiscard]] double scale() const;
  [[nodiscard]] double angle() const;  // radians, clockwise in the image (y points down)
  [[nodiscard]] Eigen::Vector2d operator()(const Eigen::Vector2d& point) const;
  [[nodiscard]] Eigen::Matrix2Xd operator()(const Eigen::Matrix2Xd& points) const;
  // Throws std::invalid_argument if the scale is 0.
  [[nodiscard]] Similarity2d inverse() const;
};

// first, then second: (second * first)(x) = second(first(x)).
[[nodiscard]] Similarity2d operator*(const Similarity2d& second, const Similarity2d& first);

// The least-squares similarity from `source` to `target` (2 x n each; closed form, as in Cootes and
// Taylor, "Statistical models of appearance", 2004, appendix B), with a weight >= 0 per point
// (empty: all 1). Points with NaN in either have weight 0. Throws std::invalid_argument for fewer
// than two points with weight, or a source without extent.
[[nodiscard]] Similarity2d fit_similarity(const Eigen::Matrix2Xd& source,
                                          const Eigen::Matrix2Xd& target,
                                          const Eigen::VectorXd& weights = {});

}  // namespace tarsier::face::shape
