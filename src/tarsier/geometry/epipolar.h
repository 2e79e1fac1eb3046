// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>

#include <array>
#include <span>

// Two views of the same points: the matrices that x' E x = 0 (x in the first image, x' in the second,
// homogeneous, third coordinate 1) from as few points as determine them.
namespace tarsier::geometry {

inline constexpr int kMaxEssentials = 10;
inline constexpr int kMaxFundamentals = 3;

// All essential matrices, of norm 1, that five pairs of normalised coordinates fit (Nister, "An
// efficient solution to the five-point relative pose problem", PAMI 2004): the null space of the five
// equations, x E1 + y E2 + z E3 + E4, is put into det E = 0 and 2 E E' E - trace(E E') E = 0; what
// is left is a polynomial of degree 10 in z, whose real roots in -100..100 are isolated by Sturm's
// theorem. Returns their number, 0 for points that do not determine any.
[[nodiscard]] int five_point(const std::array<Eigen::Vector2d, 5>& first,
                             const std::array<Eigen::Vector2d, 5>& second,
                             std::array<Eigen::Matrix3d, kMaxEssentials>& essentials);

// All fundamental matrices, of norm 1, that seven pairs fit (Hartley and Zisserman, 11.1.2).
// Coordinates of about -1..1 keep it exact.
[[nodiscard]] int seven_point(const std::array<Eigen::Vector2d, 7>& first,
                              const std::array<Eigen::Vector2d, 7>& second,
                              std::array<Eigen::Matrix3d, kMaxFundamentals>& fundamentals);

// The homography, of norm 1, that takes four points to four others; false where three lie in a
// line.
[[nodiscard]] bool four_point(const std::array<Eigen::Vector2d, 4>& first,
                              const std::array<Eigen::Vector2d, 4>& second,
                              Eigen::Matrix3d& homography);

// [t]x R of a motion second_from_first.
[[nodiscard]] Eigen::Matrix3d essential_of(const Rigid3& second_from_first);

// The four motions, of translations of length 1, that have this essential matrix up to its scale
// (Hartley and Zisserman, 9.6.2).
[[nodiscard]] std::array<Rigid3, 4> motions_of(const Eigen::Matrix3d& essential);

// The real roots in low..high, ascending, of c[0] + c[1] z + .. + c[n] z^n, n 1..10, by Sturm's theorem;
// multiple ones count once. Returns their number; `roots` has room for n.
[[nodiscard]] int real_roots(std::span<const double> coefficients, double low, double high,
                             std::span<double> roots);

}  // namespace tarsier::geometry
