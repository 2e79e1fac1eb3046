// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/surface/surface_files.h"
#include "tarsier/sfm/view/render.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <functional>

// Renders images of a surface without a display, as render_model() renders a cloud. The view is
// framed by the points of `model` (by the surface's vertices, where it has fewer than 50 points),
// and upright by its cameras. The model has the units of the surface.
namespace tarsier::sfm {

// The rotation from the world to x right, y up, z towards the viewer (Framing::base).
[[nodiscard]] Eigen::Matrix3d upright_of(const TexturedSurface& surface, const Model& model);

// CV_8UC3. Textures are unlit, colours are slightly lit, and a surface without either is grey with
// a light from the upper left. `options.cameras` and `point_px` are ignored.
[[nodiscard]] cv::Mat render_surface(const TexturedSurface& surface, const Model& model,
                                     const ViewOptions& options);

// A full turn in `frames` (>= 1) images, starting at options.yaw_deg.
void render_surface_turntable(const TexturedSurface& surface, const Model& model,
                              const ViewOptions& options, int frames,
                              const std::function<void(int, const cv::Mat&)>& take);

}  // namespace tarsier::sfm
