// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <Eigen/Core>

namespace tarsier::geometry {

// Normally distributed coordinates, for tests.
inline Eigen::Vector3d random_vector(Rng& rng) {
  return {rng.normal(), rng.normal(), rng.normal()};
}

}  // namespace tarsier::geometry
