// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/mapper_hooks.h"
#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// A separately mapped model of a part of the images.
struct MappedPart {
  std::string name;  // for the log and the report
  // With the images and cameras of all parts (join_models.h).
  Model model;
};

struct MappedParts {
  std::vector<MappedPart> parts;
  // Pairs refused during the mapping of a part, as indices into the pairs of the input.
  std::vector<std::size_t> refused_pairs;
  std::vector<std::string> reasons;  // per image: why it is in no model; may be empty
  std::vector<std::string> log;      // of the earlier runs
};

// Joins the parts (join_models()). Where the input has pairs, each model then grows as one that
// began globally: points are triangulated again from all pairs, images that no other model has are
// registered, the whole is adjusted and its tracks are extended. The result states which parts were
// joined and why others were not. Deterministic for any number of threads.
//
// Of `hooks`, checkpoints are used. Where the input has pairs, there is one after the parts are
// joined, then as in map_images(). Throws std::invalid_argument for parts whose images differ from
// the input's, Interrupted.
[[nodiscard]] Reconstruction map_joined(const MapperInput& input, const MapperOptions& options,
                                        const MappedParts& mapped, Progress& progress,
                                        const std::stop_token& stop, const MapperHooks& hooks = {});

}  // namespace tarsier::sfm
