// SPDX-License-Identifier: MIT
#pragma once

#include <numbers>

namespace tarsier {

/// Multiply degrees by it for radians.
inline constexpr double kRadiansPerDegree = std::numbers::pi / 180;

/// Multiply radians by it for degrees.
inline constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

}  // namespace tarsier
