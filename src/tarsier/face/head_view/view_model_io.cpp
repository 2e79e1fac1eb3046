// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/head_view/view_model.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face::head_view {
namespace {

using nlohmann::json;

constexpr const char* kType = "head-view";
constexpr int kVersion = 2;
constexpr std::int64_t kMaxLandmarks = 1000;
constexpr Eigen::Index kMaxCentres = 100'000;

// Row-major, as PackedArray has it.
PackedArray<float> rows_of(const Eigen::MatrixXf& matrix) {
  PackedArray<float> array;
  array.shape = {matrix.rows(), matrix.cols()};
  array.values.reserve(static_cast<std::size_t>(matrix.size()));
  for (Eigen::Index r = 0; r < matrix.rows(); ++r)
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) array.values.push_back(matrix(r, c));
  return array;
}

json packed(const Eigen::MatrixXf& matrix) { return pack(rows_of(matrix)); }

Eigen::MatrixXf unpacked(const json& object, const std::string& path, const std::string& name,
                         std::int64_t rows, std::int64_t cols) {
  const auto array = unpack<float>(member(object, name, path), path, name, {rows, cols});
  Eigen::MatrixXf matrix(array.shape[0], array.shape[1]);
  std::size_t at = 0;
  for (Eigen::Index r = 0; r < matrix.rows(); ++r)
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) matrix(r, c) = array.values[at++];
  return matrix;
}

}  // namespace

void write_view_model(const std::string& path, const ViewModel& model, const json& provenance) {
  model.check();
  json value;
  value["mean"] = packed(model.mean);
  value["basis"] = pack_half(rows_of(model.basis));
  value["angle_scale"] = packed(model.angle_scale);
  value["centres"] = pack_half(rows_of(model.centres));
  value["weights"] = packed(model.weights);
  value["gamma"] = model.gamma;
  value["most_deg"] = model.max_deg;
  value["trained_on"] = model.trained_on;
  write_archive(path, {kType, kVersion, provenance, value});
}

ViewModel read_view_model(const std::string& path) {
  const json value = read_archive(path, kType, kVersion).payload;
  ViewModel model;
  model.mean = unpacked(value, path, "mean", -1, 1);
  if (model.mean.size() < kGradients || model.mean.size() > kGradients + 2 * kMaxLandmarks)
    throw ModelError(path, fmt::format("'mean' has {} numbers", model.mean.size()));
  model.basis = unpacked(value, path, "basis", model.mean.size(), -1);
  if (model.basis.cols() < 1 || model.basis.cols() > model.mean.size())
    throw ModelError(path, fmt::format("'basis' has {} columns", model.basis.cols()));
  model.angle_scale = unpacked(value, path, "angle_scale", 3, 1);
  model.centres = unpacked(value, path, "centres", model.basis.cols() + 3, -1);
  if (model.centres.cols() > kMaxCentres)
    throw ModelError(path, fmt::format("'centres' has {} columns", model.centres.cols()));
  model.weights = unpacked(value, path, "weights", 2, model.centres.cols());
  model.gamma = number_member(value, "gamma", path);
  model.max_deg = number_member(value, "most_deg", path);
  model.trained_on = static_cast<int>(
      integer_member(value, "trained_on", path, 0, std::numeric_limits<int>::max()));
  try {
    model.check();
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, std::string("no model of head views: ") + error.what());
  }
  return model;
}

}  // namespace tarsier::face::head_view
