// SPDX-License-Identifier: MIT
#include "tarsier/face/head_view/view_model.h"
#include "tarsier/linalg/model_fields.h"

#include <nlohmann/json.hpp>

namespace tarsier::face::head_view {
namespace {

using nlohmann::json;

constexpr const char* kType = "head-view";
constexpr int kVersion = 3;
constexpr std::int64_t kMaxLandmarks = 1000;
constexpr Eigen::Index kMaxCentres = 100'000;

void list_view_model(linalg::ModelFields& file, ViewModel& model) {
  file.matrix("mean", model.mean, -1, 1);
  const Eigen::Index inputs = model.mean.size();
  file.require(inputs >= kGradients && inputs <= kGradients + 2 * kMaxLandmarks,
               "'mean' has {} numbers", inputs);
  file.half_matrix("basis", model.basis, inputs, -1);
  const Eigen::Index kept = model.basis.cols();
  file.require(kept >= 1 && kept <= inputs, "'basis' has {} columns", kept);
  file.matrix("angle_scale", model.angle_scale, 3, 1);
  file.half_matrix("centres", model.centres, kept + 3, -1);
  const Eigen::Index centres = model.centres.cols();
  file.require(centres <= kMaxCentres, "'centres' has {} columns", centres);
  file.matrix("weights", model.weights, 2, centres);
  file.number("gamma", model.gamma);
  file.number("most_deg", model.max_deg);
  file.whole("trained_on", model.trained_on, 0);
}

}  // namespace

void write_view_model(const std::string& path, const ViewModel& model, const json& provenance) {
  model.check();
  write_archive(path, {kType, kVersion, provenance, linalg::written(model, list_view_model)});
}

ViewModel read_view_model(const std::string& path) {
  return linalg::read_checked<ViewModel>(read_archive(path, kType, kVersion).payload, path,
                                         list_view_model, "no model of head views: ");
}

}  // namespace tarsier::face::head_view
