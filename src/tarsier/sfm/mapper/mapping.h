// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/mapper_hooks.h"
#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"

#include <stop_token>

// One mapping of the images. The incremental mapper starts from a pair and adds one image after the
// other (Schonberger and Frahm, CVPR 2016). The global mapper computes all poses together
// (global_start.h).
namespace tarsier::sfm {

struct MappingResult {
  Reconstruction reconstruction;
  // The scene has repeated structure: a model was rejected because of conflicts, or global mapping
  // could not close its loops.
  bool is_repetitive = false;
};

// Maps the images once, into one model after another, incrementally or globally. reconstruct()
// (reconstruction/reconstruct.h) calls it, and calls it again with fewer pairs where a scene
// repeats. Throws Interrupted and what hooks.save_checkpoint throws.
[[nodiscard]] MappingResult map_images(const MapperInput& input, const MapperOptions& options,
                                       Progress& progress, const std::stop_token& stop,
                                       const MapperHooks& hooks);

}  // namespace tarsier::sfm
