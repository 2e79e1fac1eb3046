// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper.h"

#include <stop_token>

namespace tarsier::sfm {

struct MappingResult {
  Reconstruction reconstruction;
  // The scene has repeated structure: a model was rejected because of conflicts, or global mapping
  // could not close its loops.
  bool is_repetitive = false;
};

// Maps the images once, into one model after another, incrementally or globally. reconstruct()
// (mapper.h) calls it, and calls it again with fewer pairs where a scene repeats. Throws Interrupted
// and what hooks.save_checkpoint throws.
[[nodiscard]] MappingResult map_images(const MapperInput& input, const MapperOptions& options,
                                       Progress& progress, const std::stop_token& stop,
                                       const MapperHooks& hooks);

}  // namespace tarsier::sfm
