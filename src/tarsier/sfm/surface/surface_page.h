// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_files.h"
#include "tarsier/sfm/view/viewer.h"

#include <string>

namespace tarsier::sfm {

// The layers of a page (viewer_html()).
//
// The cloud of a PLY file, at most about a million points of it, in units of `scale` for one of the file's;
// nothing where there is no such file. Throws InputError (read_cloud()).
[[nodiscard]] ViewerCloud viewer_cloud(const std::string& path, double scale = 1);

// With its texture as JPEG of quality 90, or its colours; grey where it has neither.
[[nodiscard]] ViewerSurface viewer_surface(const TexturedSurface& surface);

}  // namespace tarsier::sfm
