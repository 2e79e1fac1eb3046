// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/landmarks/descent.h"
#include "tarsier/face/landmarks/packing.h"
#include "tarsier/face/landmarks/quality.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <cmath>

namespace tarsier::face::landmarks {

namespace {

constexpr int kMaxPoints = 500;
constexpr int kMaxStages = 20;

nlohmann::json to_json(const Descent::Stage& stage) {
  return {{"px_per_unit", stage.scale.px_per_unit},
          {"cell", stage.scale.cell},
          {"center", packed(Eigen::MatrixXf(stage.center.transpose()))},
          {"components", packed(stage.components)},
          {"weights", packed_short(stage.weights)},
          {"bias", packed(Eigen::MatrixXf(stage.bias.transpose()))}};
}

Descent::Stage stage_from_json(const nlohmann::json& value, const std::string& path, int outputs,
                               Eigen::Index points) {
  Descent::Stage stage;
  stage.scale.px_per_unit = number_member(value, "px_per_unit", path, 5, 400);
  stage.scale.cell = number_member(value, "cell", path, 0.02, 1);
  stage.center =
      unpacked(member(value, "center", path), path, "center", 1, kDescriptor).transpose();
  stage.components =
      unpacked(member(value, "components", path), path, "components", kDescriptor, -1);
  const Eigen::Index kept = stage.components.cols();
  if (kept < 1 || kept > kDescriptor) {
    throw ModelError(path, fmt::format("{} components of a descriptor of {}", kept, kDescriptor));
  }
  stage.weights =
      unpacked_short(member(value, "weights", path), path, "weights", outputs, points * kept);
  stage.bias = unpacked(member(value, "bias", path), path, "bias", 1, outputs).transpose();
  return stage;
}

}  // namespace

nlohmann::json to_json(const Descent& model) {
  model.check();
  nlohmann::json stages = nlohmann::json::array();
  for (const Descent::Stage& stage : model.stages) stages.push_back(to_json(stage));
  return {{"mean", packed(model.mean.cast<float>())}, {"stages", std::move(stages)}};
}

Descent descent_from_json(const nlohmann::json& value, const std::string& path) {
  Descent model;
  model.mean = mean_from_json(value, path);
  const nlohmann::json& stages = member(value, "stages", path);
  if (!stages.is_array() || stages.empty() || stages.size() > kMaxStages) {
    throw ModelError(path, fmt::format("stages must be a list of 1..{}", kMaxStages));
  }
  for (const nlohmann::json& stage : stages) {
    model.stages.push_back(
        stage_from_json(stage, path, static_cast<int>(2 * model.mean.cols()), model.mean.cols()));
  }
  return model;
}

nlohmann::json to_json(const Quality& model) {
  return {{"mean", packed(model.mean.cast<float>())}, {"stage", to_json(model.stage)}};
}

Quality quality_from_json(const nlohmann::json& value, const std::string& path) {
  Quality model;
  model.mean = mean_from_json(value, path);
  model.stage = stage_from_json(member(value, "stage", path), path, 1, model.mean.cols());
  return model;
}

Eigen::Matrix2Xd mean_from_json(const nlohmann::json& value, const std::string& path) {
  const Eigen::MatrixXf mean = unpacked(member(value, "mean", path), path, "mean", 2, -1);
  if (mean.cols() < 2 || mean.cols() > kMaxPoints) {
    throw ModelError(path, fmt::format("{} points; 2..{} are possible", mean.cols(), kMaxPoints));
  }
  const Eigen::Matrix2Xd exact = mean.cast<double>();
  const double size = shape_size(exact);
  if (!(size > 0.5 && size < 2)) throw ModelError(path, "its mean shape is not of size 1");
  return exact;
}

}  // namespace tarsier::face::landmarks
