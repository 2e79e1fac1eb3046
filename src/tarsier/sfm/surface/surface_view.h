// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/surface/surface_files.h"
#include "tarsier/sfm/view/render.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <functional>

// Images of a surface, drawn without a display, as render_model() draws a cloud: framed by the
// points of `model` (by the surface's vertices, where it has fewer than 50), upright by its cameras. The model has
// the surface's units.
namespace tarsier::sfm {

// The rotation of the world to x right, y up, z towards who looks at it (Framing::base).
[[nodiscard]] Eigen::Matrix3d upright_of(const TexturedSurface& surface, const Model& model);

// CV_8UC3; textures are not lit, colours a little, and what has none is grey in a light from the
// upper left. `options.cameras` and `point_px` are not looked at.
[[nodiscard]] cv::Mat render_surface(const TexturedSurface& surface, const Model& model,
                                     const ViewOptions& options);

// A full turn in `frames` (>= 1) images, from options.yaw_deg on.
void render_surface_turntable(const TexturedSurface& surface, const Model& model,
                              const ViewOptions& options, int frames,
                              const std::function<void(int, const cv::Mat&)>& take);

}  // namespace tarsier::sfm
