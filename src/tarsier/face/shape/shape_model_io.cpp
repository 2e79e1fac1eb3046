// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/markup_check.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/linalg/model_fields.h"

#include <nlohmann/json.hpp>

namespace tarsier::face::shape {
namespace {

using nlohmann::json;

constexpr const char* kShapeModelType = "shape-model";
constexpr int kShapeModelVersion = 1;

void list_shape_model(linalg::ModelFields& file, ShapeModel& model) {
  file.matrix("mean", model.mean, 2, -1);
  file.require(model.points() >= 2 && model.points() <= kMaxPoints, "'mean' has {} points",
               model.points());
  file.matrix("modes", model.modes, model.mean.size(), -1);
  file.matrix("deviation", model.deviation, model.modes.cols(), 1);
  file.number("variance_kept", model.variance_kept, 0, 1);
  file.whole("trained_on", model.trained_on, 0);
  file.other("mirror", model.mirror, [&](const json& object, const std::string& path) {
    return mirror_from_json(object, path, model.points());
  });
  file.other("connections", model.connections, [&](const json& object, const std::string& path) {
    return connections_from_json(object, path, model.points());
  });
}

}  // namespace

json to_json(const ShapeModel& model) {
  model.check();
  return linalg::written(model, list_shape_model);
}

ShapeModel shape_model_from_json(const json& value, const std::string& path) {
  return linalg::read_checked<ShapeModel>(value, path, list_shape_model, "no shape model: ");
}

void write_shape_model(const std::string& path, const ShapeModel& model, const json& provenance) {
  write_archive(path, {kShapeModelType, kShapeModelVersion, provenance, to_json(model)});
}

ShapeModel read_shape_model(const std::string& path) {
  return shape_model_from_json(read_archive(path, kShapeModelType, kShapeModelVersion).payload,
                               path);
}

}  // namespace tarsier::face::shape
