// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/packing.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>

namespace tarsier::face::regression {

namespace {

constexpr float kMaxQuantised = 32767;
constexpr Eigen::Index kMaxPoints = 500;

}  // namespace

void list_mean(linalg::ModelFields& file, Eigen::Matrix2Xd& mean) {
  file.matrix<float>("mean", mean, 2, -1);
  file.require(mean.cols() >= 2 && mean.cols() <= kMaxPoints, "{} points; 2..{} are possible",
               mean.cols(), kMaxPoints);
  const double size = shape_size(mean);
  file.require(size > 0.5 && size < 2, "its mean shape is not of size 1");
}

nlohmann::json packed_short(const Eigen::MatrixXf& matrix) {
  PackedArray<float> steps;
  steps.shape = {matrix.rows()};
  PackedArray<std::uint8_t> bytes;
  bytes.shape = {matrix.rows(), matrix.cols(), 2};
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    const float largest = matrix.cols() > 0 ? matrix.row(r).cwiseAbs().maxCoeff() : 0.F;
    const float step = largest > 0 ? largest / kMaxQuantised : 1.F;
    steps.values.push_back(step);
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
      const auto whole = static_cast<std::uint16_t>(static_cast<std::int16_t>(
          std::clamp(std::round(matrix(r, c) / step), -kMaxQuantised, kMaxQuantised)));
      bytes.values.push_back(static_cast<std::uint8_t>(whole & 0xFF));
      bytes.values.push_back(static_cast<std::uint8_t>(whole >> 8));
    }
  }
  return {{"steps", pack(steps)}, {"values", pack(bytes)}};
}

Eigen::MatrixXf unpacked_short(const nlohmann::json& value, const std::string& path,
                               std::string_view what, Eigen::Index rows, Eigen::Index columns) {
  const PackedArray<float> steps = unpack<float>(member(value, "steps", path), path, what, {rows});
  const PackedArray<std::uint8_t> bytes =
      unpack<std::uint8_t>(member(value, "values", path), path, what, {steps.shape[0], columns, 2});
  Eigen::MatrixXf matrix(bytes.shape[0], bytes.shape[1]);
  std::size_t index = 0;
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    const float step = steps.values[static_cast<std::size_t>(r)];
    if (!(step > 0 && step < 1e6F)) {
      throw ModelError(path, fmt::format("{}: step {} of row {}", what, step, r));
    }
    for (Eigen::Index c = 0; c < matrix.cols(); ++c, index += 2) {
      const auto whole = static_cast<std::int16_t>(
          static_cast<std::uint16_t>(bytes.values[index] | (bytes.values[index + 1] << 8)));
      matrix(r, c) = static_cast<float>(whole) * step;
    }
  }
  return matrix;
}

}  // namespace tarsier::face::regression
