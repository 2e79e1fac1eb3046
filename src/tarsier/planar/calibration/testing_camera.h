// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

namespace tarsier::planar::calibration {

// The camera of a phone, for tests.
inline geometry::Camera phone() {
  return {640, 480, 520.5, 518.25, 321, 238.5, {-0.28, 0.09, 1e-3, -2e-3, -0.01}, 0};
}

}  // namespace tarsier::planar::calibration
