// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

// Matrices in model files.
namespace tarsier::face::landmarks {

// Row by row, single precision.
[[nodiscard]] nlohmann::json packed(const Eigen::MatrixXf& matrix);
// -1: any number of rows or columns. Throws ModelError(path) naming `what`.
[[nodiscard]] Eigen::MatrixXf unpacked(const nlohmann::json& value, const std::string& path,
                                       std::string_view what, Eigen::Index rows,
                                       Eigen::Index columns);

// 16 bits a number: each row times its own step. Half the size; an error of 1/65000 of a row's
// largest number.
[[nodiscard]] nlohmann::json packed_short(const Eigen::MatrixXf& matrix);
[[nodiscard]] Eigen::MatrixXf unpacked_short(const nlohmann::json& value, const std::string& path,
                                             std::string_view what, Eigen::Index rows,
                                             Eigen::Index columns);

// Member "mean": 2 x n, size 1.
[[nodiscard]] Eigen::Matrix2Xd mean_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::landmarks
