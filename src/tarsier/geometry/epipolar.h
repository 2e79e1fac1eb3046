// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>

#include <array>
#include <span>

// Minimal solvers for two views: the matrices with x' E x = 0 (x in the first image, x' in the
// second, homogeneous, third coordinate 1) from the minimum number of correspondences.
namespace tarsier::geometry {

inline constexpr int kMaxEssentials = 10;
inline constexpr int kMaxFundamentals = 3;

// All essential matrices, of norm 1, that fit five pairs of normalised coordinates (Nister, "An
// efficient solution to the five-point relative pose problem", PAMI 2004). The null space of the
// five equations, x E1 + y E2 + z E3 + E4, is substituted into det E = 0 and 2 E E' E - trace(E E')
// E = 0. This gives a polynomial of degree 10 in z, whose real roots in -100..100 are isolated by
// Sturm's theorem. Returns the number of matrices, 0 for degenerate points.
[[nodiscard]] int five_point(const std::array<Eigen::Vector2d, 5>& first,
                             const std::array<Eigen::Vector2d, 5>& second,
                             std::array<Eigen::Matrix3d, kMaxEssentials>& essentials);

// All fundamental matrices, of norm 1, that fit seven pairs (Hartley and Zisserman, 11.1.2).
// Normalise the coordinates to about -1..1 for accuracy.
[[nodiscard]] int seven_point(const std::array<Eigen::Vector2d, 7>& first,
                              const std::array<Eigen::Vector2d, 7>& second,
                              std::array<Eigen::Matrix3d, kMaxFundamentals>& fundamentals);

// The homography, of norm 1, that maps four points to four others; false if three points are
// collinear.
[[nodiscard]] bool four_point(const std::array<Eigen::Vector2d, 4>& first,
                              const std::array<Eigen::Vector2d, 4>& second,
                              Eigen::Matrix3d& homography);

// The essential matrix [t]x R of a motion second_from_first.
[[nodiscard]] Eigen::Matrix3d essential_of(const Rigid3& second_from_first);

// The four motions, with translations of length 1, whose essential matrix is this one up to scale
// (Hartley and Zisserman, 9.6.2).
[[nodiscard]] std::array<Rigid3, 4> motions_of(const Eigen::Matrix3d& essential);

// The real roots in low..high, ascending, of c[0] + c[1] z + .. + c[n] z^n, n 1..10, by Sturm's
// theorem. Multiple roots count once. Returns their number; `roots` has room for n.
[[nodiscard]] int real_roots(std::span<const double> coefficients, double low, double high,
                             std::span<double> roots);

}  // namespace tarsier::geometry
