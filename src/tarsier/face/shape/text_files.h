// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/mesh.h"

#include <Eigen/Core>

#include <string>
#include <vector>

// Plain text, '#' begins a comment. All throw InputError(path) that names the line.
namespace tarsier::face::shape {

// Shapes without images: the first line is "N 2k" (N shapes of k points), then N lines
// "x1 y1 ... xk yk". Each 2 x k.
[[nodiscard]] std::vector<Eigen::Matrix2Xd> read_text_shapes(const std::string& path);
// Whether a file begins as such a one does: two whole numbers and nothing else on its first line.
[[nodiscard]] bool is_text_shapes(const std::string& path);

// Triangles, three point numbers (from 0) a line. Refused: numbers outside of 0..points-1, corners
// that are the same.
[[nodiscard]] std::vector<Triangle> read_triangles(const std::string& path, int points);

}  // namespace tarsier::face::shape
