// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <functional>
#include <optional>
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

// Both may be empty.
struct GlobalStartHooks {
  // Sees where the work is after the graph is checked, each averaging of rotations, the positions, and each adjustment.
  std::function<void(GlobalStartState state)> keep;
  // Continues from there, with the same arguments otherwise: the result is the same, to the last bit. One that does not
  // fit them is ignored. Is not read any more once `keep` was called.
  const GlobalStartState* from = nullptr;
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
                                         const MapperOptions& options, const std::stop_token& stop,
                                         const GlobalStartHooks& hooks = {});

// The rough model at one of the steps. `tracks`: of its points, in the same order. Empty before the step that adjusts, where
// fewer than two images have poses, and where the state does not fit the other arguments, which are those of
// start_globally().
struct GlobalModelSoFar {
  Model model;
  std::vector<std::vector<Observation>> tracks;
};
[[nodiscard]] std::optional<GlobalModelSoFar> model_so_far(
    const GlobalStartState& state, const std::vector<geometry::Camera>& cameras,
    const std::vector<Image>& images, const std::vector<const Pair*>& pairs,
    const MapperOptions& options);

}  // namespace tarsier::sfm
