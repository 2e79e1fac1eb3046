// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/media/archive.h"

#include <exception>
#include <utility>

namespace tarsier::face::landmarks {

namespace {
constexpr const char* kType = "landmark-tracker";
constexpr int kVersion = 1;
}  // namespace

void write_landmark_model(const std::string& path, const LandmarkModel& model,
                          const nlohmann::json& provenance) {
  model.check();
  nlohmann::json payload = {
      {"shape", shape::to_json(model.shape)}, {"box", to_json(model.box)}, {"eyes", model.eyes}};
  if (model.trees) payload["trees"] = to_json(*model.trees);
  if (model.descent) payload["descent"] = to_json(*model.descent);
  if (model.network) payload["network"] = to_json(*model.network);
  if (model.patches) payload["patches"] = to_json(*model.patches);
  if (model.quality) payload["quality"] = to_json(*model.quality);
  if (model.visibility) payload["visibility"] = to_json(*model.visibility);
  write_archive(path, {kType, kVersion, provenance, std::move(payload)});
}

LandmarkModel read_landmark_model(const std::string& path) {
  const Archive archive = read_archive(path, kType, kVersion);
  const nlohmann::json& payload = archive.payload;
  LandmarkModel model;
  model.shape = shape::shape_model_from_json(member(payload, "shape", path), path);
  model.box = box_model_from_json(member(payload, "box", path), path);
  const nlohmann::json& eyes = member(payload, "eyes", path);
  if (!eyes.is_array() || eyes.size() != 2) throw ModelError(path, "eyes must be two points");
  for (std::size_t k = 0; k < 2; ++k) {
    if (!eyes[k].is_number_integer() || eyes[k].get<std::int64_t>() < -1 ||
        eyes[k].get<std::int64_t>() >= model.points()) {
      throw ModelError(path, "eyes name points that do not exist");
    }
    model.eyes[k] = eyes[k].get<int>();
  }
  if (payload.contains("trees")) model.trees = trees_from_json(payload["trees"], path);
  if (payload.contains("descent")) model.descent = descent_from_json(payload["descent"], path);
  if (payload.contains("network"))
    model.network = regression_network_from_json(payload["network"], path);
  if (payload.contains("patches")) {
    model.patches = patch_models_from_json(payload["patches"], path);
  }
  if (payload.contains("quality")) model.quality = quality_from_json(payload["quality"], path);
  if (payload.contains("visibility"))
    model.visibility = visibility_from_json(payload["visibility"], path);
  return checked(std::move(model), path);
}

nlohmann::json landmark_model_provenance(const std::string& path) {
  return read_archive(path, kType, kVersion).provenance;
}

}  // namespace tarsier::face::landmarks
