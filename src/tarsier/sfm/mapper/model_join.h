// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/sim3.h"

#include <string>

namespace tarsier::sfm {

// The relation of two models that share images (find_join() in joining/join_models.h).
struct ModelJoin {
  int first = 0;  // indices of the models
  int second = 0;
  int images = 0;    // common images
  int agreeing = 0;  // of these, with the same pose in both
  int points = 0;    // common points
  int inliers = 0;
  double rotation_deg = 0;  // median angle between the two poses of a common image
  double scale_error = 0;   // relative standard error of the scale
  geometry::Sim3 first_from_second;
  std::string refusal;  // why they are not joined; "" where they are
};

}  // namespace tarsier::sfm
