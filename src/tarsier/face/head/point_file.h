// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <string>

namespace tarsier::face::head {

// Points of a text file: `dimensions` numbers a line, blanks or commas between them, '#' begins a
// comment; dimensions x n. Throws InputError with path and line: missing, larger than 10 MB,
// another number of numbers in a line, not finite, beyond 1e9, more than 100 000 points, none.
[[nodiscard]] Eigen::MatrixXd read_point_file(const std::string& path, int dimensions);

// 3D landmarks to compare a head with: as above, or with the count in a first line "68" or "68 100"
// after which only so many points are read (3 x n).
[[nodiscard]] Eigen::Matrix3Xd read_landmarks3d(const std::string& path);

}  // namespace tarsier::face::head
