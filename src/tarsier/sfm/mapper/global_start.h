// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct GlobalStart {
  Model model;                // cameras and poses; no points
  std::string refusal;        // why there is none, or ""
  std::vector<Doubt> doubts;  // of each of the pairs: why it was left out
  std::vector<std::string> log;
};

// All poses of a set of images at once, without a first pair (Moulon, Monasse and Marlet, Global fusion of relative
// motions for robust, accurate and scalable structure from motion, ICCV 2013, and Pan et al., ECCV 2024, describe the
// order of the steps):
//
//   1. the view graph of `pairs`, without those that no cycle of three confirms (global/view_graph.h);
//   2. rotations (global/rotation_averaging.h), without pairs that are 10 degrees off or more;
//   3. cameras and points of the longest tracks (global/positioning.h);
//   4. bundle adjustment, at first of all that is roughly right, then of what is near.
//
// Images that no step confirms are not registered. `images`: those of the component with their features, others
// without. Refused where too few images or too few observations agree, which is what a scene that repeats itself or a
// wrong focal length does. One thread. Throws Interrupted.
[[nodiscard]] GlobalStart start_globally(const std::vector<geometry::Camera>& cameras,
                                         const std::vector<Image>& images,
                                         const std::vector<const Pair*>& pairs,
                                         const MapperOptions& options, const std::stop_token& stop);

}  // namespace tarsier::sfm
