// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// Limits of points, and symmetry and connections of landmark sets and shape models: checks and
// JSON. For the .cpp files of this module.
namespace tarsier::face::shape {

inline constexpr int kMaxPoints = 10000;
inline constexpr double kMaxCoordinate = 1e7;  // px

// Throw std::invalid_argument unless all indices are within `points` points, and the mirror is
// empty or an involution of all points.
void check_mirror(const std::vector<int>& mirror, int points);
void check_connections(const std::vector<std::array<int, 2>>& connections, int points);

// [i, ..] and [[i, j], ..]; a missing member gives an empty list. Throw ModelError(path).
[[nodiscard]] std::vector<int> mirror_from_json(const nlohmann::json& object,
                                                const std::string& path, int points);
[[nodiscard]] std::vector<std::array<int, 2>> connections_from_json(const nlohmann::json& object,
                                                                    const std::string& path,
                                                                    int points);

}  // namespace tarsier::face::shape
