// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/mesh.h"

#include <Eigen/Core>

#include <string>
#include <vector>

// Plain text files; '#' begins a comment. All functions throw InputError(path) that names the line.
namespace tarsier::face::shape {

// Shapes without images: the first line is "N 2k" (N shapes of k points), then N lines
// "x1 y1 ... xk yk". Each 2 x k.
[[nodiscard]] std::vector<Eigen::Matrix2Xd> read_text_shapes(const std::string& path);
// Whether a file begins like such a file: two integers and nothing else on its first line.
[[nodiscard]] bool is_text_shapes(const std::string& path);

// Triangles, three point numbers (from 0) per line. Numbers outside 0..points-1 and equal corners
// are errors.
[[nodiscard]] std::vector<Triangle> read_triangles(const std::string& path, int points);

}  // namespace tarsier::face::shape
