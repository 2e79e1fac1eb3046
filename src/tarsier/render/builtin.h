// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/render/mesh.h"

#include <opencv2/core/matx.hpp>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

// Procedural meshes. Colours are BGR, 0..1.
namespace tarsier::render {

// A cube of edge 1, centred on the origin; z is up. Each face has its own colour. With `texture`,
// each face shows the whole texture upright (u to the right, v up as seen from outside).
[[nodiscard]] Mesh make_cube();
[[nodiscard]] Mesh make_cube(const Texture& texture);

// Three arrows of length 1 from the origin: x red, y green, z blue. `thickness`: of the shaft,
// > 0.
[[nodiscard]] Mesh make_axes(double thickness = 0.04);

// A sphere of radius 1, with `rings` from pole to pole (2..2000) and twice as many segments around:
// 4 rings (rings - 1) triangles.
[[nodiscard]] Mesh make_sphere(int rings, const cv::Vec3f& color);

// Meshes for a head in the frame of face::head::HeadModel: mm, origin midway between the outer eye
// corners, x to image right, y down, z away from the camera; 89 mm between the eye corners.
[[nodiscard]] Mesh make_glasses();
[[nodiscard]] Mesh make_hat();

// "cube", "axes", "sphere", "glasses", "hat"; empty for other names.
[[nodiscard]] std::optional<Mesh> builtin_mesh(std::string_view name);
[[nodiscard]] const std::vector<std::string>& builtin_names();

}  // namespace tarsier::render
