// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/shape/markup_check.h"
#include "tarsier/face/shape/packed_matrix.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/media/archive.h"

#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face::shape {
namespace {

using nlohmann::json;

constexpr const char* kType = "shape-model";
constexpr int kVersion = 1;

}  // namespace

json to_json(const ShapeModel& model) {
  model.check();
  const Eigen::Index rows = model.mean.size();
  json value;
  value["mean"] = packed(model.mean);
  value["modes"] = model.mode_count() > 0 ? packed(model.modes) : packed(Eigen::MatrixXd(rows, 0));
  value["deviation"] = packed(model.deviation);
  value["variance_kept"] = model.variance_kept;
  value["trained_on"] = model.trained_on;
  value["mirror"] = model.mirror;
  value["connections"] = model.connections;
  return value;
}

ShapeModel shape_model_from_json(const json& value, const std::string& path) {
  ShapeModel model;
  model.mean = unpacked(value, path, "mean", 2, -1);
  if (model.mean.cols() < 2 || model.mean.cols() > kMaxPoints) {
    throw ModelError(path, "'mean' has " + std::to_string(model.mean.cols()) + " points");
  }
  model.modes = unpacked(value, path, "modes", model.mean.size(), -1);
  model.deviation = unpacked(value, path, "deviation", model.modes.cols(), 1);
  model.variance_kept = number_member(value, "variance_kept", path, 0, 1);
  model.trained_on = static_cast<int>(
      integer_member(value, "trained_on", path, 0, std::numeric_limits<int>::max()));
  model.mirror = mirror_from_json(value, path, model.points());
  model.connections = connections_from_json(value, path, model.points());
  try {
    model.check();
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, std::string("no shape model: ") + error.what());
  }
  return model;
}

void write_shape_model(const std::string& path, const ShapeModel& model, const json& provenance) {
  write_archive(path, {kType, kVersion, provenance, to_json(model)});
}

ShapeModel read_shape_model(const std::string& path) {
  return shape_model_from_json(read_archive(path, kType, kVersion).payload, path);
}

}  // namespace tarsier::face::shape
