// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::face::shape {

// Matrices in model files: row-major PackedArrays of doubles (media/archive.h).
[[nodiscard]] nlohmann::json packed(const Eigen::MatrixXd& matrix);
// `object[name]`, which must have `rows` x `cols` numbers (-1: any); else ModelError names `path`.
[[nodiscard]] Eigen::MatrixXd unpacked(const nlohmann::json& object, const std::string& path,
                                       const std::string& name, std::int64_t rows,
                                       std::int64_t cols);

}  // namespace tarsier::face::shape
