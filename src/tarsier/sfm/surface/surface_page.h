// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_files.h"
#include "tarsier/sfm/view/viewer.h"

#include <string>

namespace tarsier::sfm {

// Layers of a page, see viewer_html().
//
// The cloud of a PLY file, with at most about a million points, in units of `scale` per unit of the
// file; empty where there is no such file. Throws InputError (read_cloud()).
[[nodiscard]] ViewerCloud viewer_cloud(const std::string& path, double scale = 1);

// With the texture as JPEG of quality 90, or with colours; grey where there is neither.
[[nodiscard]] ViewerSurface viewer_surface(const TexturedSurface& surface);

}  // namespace tarsier::sfm
