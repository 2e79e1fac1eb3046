// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/synth/height_field.h"
#include "tarsier/synth/sfm_scene.h"
#include "tarsier/synth/sfm_scene_solids.h"

#include <opencv2/core.hpp>

#include <span>
#include <stop_token>

// Triangulates the surface of sfm_scene.h. Internal to this module.
namespace tarsier::synth {

// The field over `region` (x, y) and the solids on it, as in SfmScene::surface(). Throws
// Interrupted.
[[nodiscard]] SceneSurface triangulate(const HeightField& field, std::span<const Solid> solids,
                                       const geometry::Camera& camera,
                                       std::span<const geometry::Rigid3> poses, cv::Rect2d region,
                                       double step, const std::stop_token& stop);

}  // namespace tarsier::synth
