// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/synth/sfm_scene.h"

#include "framework/cli.h"
#include <string>

namespace tarsier::cli {

// Writes the ground truth for `sfm eval --dense` as a workspace (sfm/dense/workspace.h) without
// images: the exact cameras, surface points with the images that see them, depth maps and normal
// maps; and the exact surface as mesh.ply. Images are named 0000.jpg ... Throws OutputError,
// Interrupted.
void write_depth_truth(const std::string& folder, const synth::SfmScene& scene,
                       const Context& context);

}  // namespace tarsier::cli
