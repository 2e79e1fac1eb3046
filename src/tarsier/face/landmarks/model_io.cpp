// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/model.h"
#include "tarsier/linalg/model_fields.h"

#include <nlohmann/json.hpp>

namespace tarsier::face::landmarks {

namespace {

constexpr const char* kLandmarkModelType = "landmark-tracker";
constexpr int kLandmarkModelVersion = 1;

void list_model(linalg::ModelFields& file, LandmarkModel& model) {
  file.item("shape", model.shape, shape::shape_model_from_json);
  file.item("box", model.box, box_model_from_json);
  file.other("eyes", model.eyes, [&](const nlohmann::json& object, const std::string& path) {
    const nlohmann::json& eyes = member(object, "eyes", path);
    file.require(eyes.is_array() && eyes.size() == 2, "eyes must be two points");
    for (const nlohmann::json& eye : eyes)
      file.require(eye.is_number_integer() && eye >= -1 && eye < model.points(),
                   "eyes name points that do not exist");
    return std::array{eyes[0].get<int>(), eyes[1].get<int>()};
  });
  file.optional("trees", model.trees, regression::trees_from_json);
  file.optional("descent", model.descent, regression::descent_from_json);
  file.optional("network", model.network, regression::regression_network_from_json);
  file.optional("patches", model.patches, regression::patch_models_from_json);
  file.optional("quality", model.quality, regression::quality_from_json);
  file.optional("visibility", model.visibility, regression::visibility_from_json);
}

}  // namespace

void write_landmark_model(const std::string& path, const LandmarkModel& model,
                          const nlohmann::json& provenance) {
  model.check();
  write_archive(path, {kLandmarkModelType, kLandmarkModelVersion, provenance,
                       linalg::written(model, list_model)});
}

LandmarkModel read_landmark_model(const std::string& path) {
  return linalg::read_checked<LandmarkModel>(
      read_archive(path, kLandmarkModelType, kLandmarkModelVersion).payload, path, list_model);
}

nlohmann::json landmark_model_provenance(const std::string& path) {
  return read_archive(path, kLandmarkModelType, kLandmarkModelVersion).provenance;
}

}  // namespace tarsier::face::landmarks
