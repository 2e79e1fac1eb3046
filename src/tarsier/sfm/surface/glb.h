// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_files.h"

#include <Eigen/Core>

#include <string>

namespace tarsier::sfm {

// The content of a binary glTF 2.0 file, see write_surface(). `name` appears in errors.
[[nodiscard]] std::string glb_of(const TexturedSurface& surface, const Eigen::Matrix3d& upright,
                                 const std::string& name);

}  // namespace tarsier::sfm
