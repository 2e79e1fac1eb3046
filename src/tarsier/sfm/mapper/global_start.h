// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct GlobalStart {
  Model model;                            // cameras and poses; no points
  std::string refusal;                    // why there is no model; or ""
  std::vector<PairRejection> rejections;  // for each pair: why it was left out
  std::vector<std::string> log;
};

// Both may be empty.
struct GlobalStartHooks {
  // Receives the state after the check of the graph, each rotation averaging, the positioning, and
  // each adjustment.
  std::function<void(GlobalStartState state)> save_checkpoint;
  // Resumes from this state. With otherwise equal arguments the result is bit-identical. Ignored
  // where it does not fit them. Not read after the first call of `save_checkpoint`.
  const GlobalStartState* resume_from = nullptr;
};

// Computes all poses of a set of images together, without an initial pair. Moulon, Monasse and
// Marlet (Global fusion of relative motions for robust, accurate and scalable structure from
// motion, ICCV 2013) and Pan et al. (ECCV 2024) describe the order of the steps:
// 1. the view graph of `pairs`, without pairs that no cycle of three confirms
//    (global/view_graph.h);
// 2. rotations (global/rotation_averaging.h), without pairs whose error is 10 degrees or more;
// 3. cameras and points of the longest tracks (global/positioning.h);
// 4. bundle adjustment, first of all roughly correct observations, then of accurate ones.
//
// Images that no step confirms are not registered. `images`: those of the component with their
// features, the others without. Refused where too few images or observations agree, as in a scene
// that repeats itself or with a wrong focal length. Uses one thread. Throws Interrupted.
[[nodiscard]] GlobalStart start_globally(const std::vector<geometry::Camera>& cameras,
                                         const std::vector<Image>& images,
                                         const std::vector<const Pair*>& pairs,
                                         const MapperOptions& options, const std::stop_token& stop,
                                         const GlobalStartHooks& hooks = {});

// The rough model at one of the steps. `tracks`: of its points, in the same order. Empty before the
// adjustment, where fewer than two images have poses, and where the state does not fit the other
// arguments, which are those of start_globally().
struct PartialGlobalModel {
  Model model;
  std::vector<std::vector<Observation>> tracks;
};
[[nodiscard]] std::optional<PartialGlobalModel> partial_model(
    const GlobalStartState& state, const std::vector<geometry::Camera>& cameras,
    const std::vector<Image>& images, const std::vector<const Pair*>& pairs,
    const MapperOptions& options);

}  // namespace tarsier::sfm
