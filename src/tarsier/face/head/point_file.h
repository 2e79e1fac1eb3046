// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <string>

namespace tarsier::face::head {

// Reads points from a text file: `dimensions` numbers per line, separated by blanks or commas; '#'
// begins a comment. Returns dimensions x n. Throws InputError with path and line: missing file,
// larger than 10 MB, wrong count of numbers in a line, not finite, beyond 1e9, more than 100 000
// points, no points.
[[nodiscard]] Eigen::MatrixXd read_point_file(const std::string& path, int dimensions);

// 3D landmarks for comparison with a head: as above, or with a first line "68" or "68 100" that
// gives the number of points to read (3 x n).
[[nodiscard]] Eigen::Matrix3Xd read_landmarks3d(const std::string& path);

}  // namespace tarsier::face::head
