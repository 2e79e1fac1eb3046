// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/synth/relief.h"

#include "framework/cli.h"
#include <string>

namespace tarsier::cli {

// What `sfm eval --dense` compares with, as a workspace (sfm/dense/workspace.h) without images: the exact
// cameras, points of the surface with what sees them, depth and normal maps; and mesh.ply, the exact
// surface. Images are named 0000.jpg ..
// Throws OutputError, Interrupted.
void write_depth_truth(const std::string& folder, const synth::ReliefScene& scene,
                       const Context& context);

}  // namespace tarsier::cli
