// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/packing.h"
#include "tarsier/face/regression/quality.h"

#include <nlohmann/json.hpp>

namespace tarsier::face::regression {

namespace {

constexpr int kMaxStages = 20;

void list_stage(linalg::ModelFields& file, Descent::Stage& stage, Eigen::Index outputs,
                Eigen::Index points) {
  file.number("px_per_unit", stage.scale.px_per_unit, 5, 400);
  file.number("cell", stage.scale.cell, 0.02, 1);
  file.matrix("center", stage.center, 1, kDescriptor);
  file.matrix("components", stage.components, kDescriptor, -1);
  const Eigen::Index kept = stage.components.cols();
  file.require(kept >= 1 && kept <= kDescriptor, "{} components of a descriptor of {}", kept,
               kDescriptor);
  file.item("weights", stage.weights, packed_short,
            [&](const nlohmann::json& value, const std::string& path) {
              return unpacked_short(value, path, "weights", outputs, points * kept);
            });
  file.matrix("bias", stage.bias, 1, outputs);
}

void list_descent(linalg::ModelFields& file, Descent& model) {
  list_mean(file, model.mean);
  const Eigen::Index points = model.mean.cols();
  file.parts("stages", model.stages, 1, kMaxStages,
             [&](linalg::ModelFields& item, Descent::Stage& stage) {
               list_stage(item, stage, 2 * points, points);
             });
}

void list_quality(linalg::ModelFields& file, Quality& model) {
  list_mean(file, model.mean);
  file.part("stage", model.stage, [&](linalg::ModelFields& part, Descent::Stage& stage) {
    list_stage(part, stage, 1, model.mean.cols());
  });
}

}  // namespace

nlohmann::json to_json(const Descent& model) {
  model.check();
  return linalg::written(model, list_descent);
}

Descent descent_from_json(const nlohmann::json& value, const std::string& path) {
  return linalg::read_fields<Descent>(value, path, list_descent);
}

nlohmann::json to_json(const Quality& model) { return linalg::written(model, list_quality); }

Quality quality_from_json(const nlohmann::json& value, const std::string& path) {
  return linalg::read_fields<Quality>(value, path, list_quality);
}

}  // namespace tarsier::face::regression
