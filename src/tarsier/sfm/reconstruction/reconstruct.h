// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/mapper_hooks.h"
#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"

#include <stop_token>

// Reconstruction from matched images. They are mapped once (mapper/mapping.h), and where the scene
// repeats, again from other pairs (strong_pairs.h, joint_correction.h).
namespace tarsier::sfm {

// Throws Interrupted, and what hooks.save_checkpoint throws.
[[nodiscard]] Reconstruction reconstruct(const MapperInput& input, const MapperOptions& options,
                                         Progress& progress, const std::stop_token& stop,
                                         const MapperHooks& hooks = {});

}  // namespace tarsier::sfm
