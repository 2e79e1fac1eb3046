// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/model_fields.h"

#include <Eigen/Core>

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

// File formats shared by the parts of a landmark model.
namespace tarsier::face::regression {

// "mean": 2 x n in single precision, size 1.
void list_mean(linalg::ModelFields& file, Eigen::Matrix2Xd& mean);

// 16 bits per number, with one step per row. Half the size, with an error of 1/65000 of a row's
// largest number.
[[nodiscard]] nlohmann::json packed_short(const Eigen::MatrixXf& matrix);
// -1: any number of columns. Throws ModelError(path) that names `what`.
[[nodiscard]] Eigen::MatrixXf unpacked_short(const nlohmann::json& value, const std::string& path,
                                             std::string_view what, Eigen::Index rows,
                                             Eigen::Index columns);

}  // namespace tarsier::face::regression
