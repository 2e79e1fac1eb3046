// SPDX-License-Identifier: MIT
#include "tarsier/core/name_table.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/linalg/model_fields.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::face::regression {
namespace {

constexpr NameTable<PatchMethod, 3> kPatchMethods{"method",
                                                  {{{PatchMethod::kStochastic, "stochastic"},
                                                    {PatchMethod::kRidge, "ridge"},
                                                    {PatchMethod::kAverage, "average"}}}};

constexpr std::int64_t kMaxPatches = 10'000;

void list_patches(linalg::ModelFields& file, PatchModels& model) {
  file.named("method", model.method, kPatchMethods);
  file.points("reference", model.reference, -1);
  const std::int64_t n = model.reference.cols();
  file.require(n >= 1 && n <= kMaxPatches, "reference: {} points, not 1..{}", n, kMaxPatches);
  PackedArray<float> patches;
  if (!file.reads()) patches.shape = {n, model.side(), model.side()};
  for (const cv::Mat& patch : model.patches)
    patches.values.insert(patches.values.end(), patch.ptr<float>(),
                          patch.ptr<float>() + patch.total());
  file.array("patches", patches, {n, -1, -1});
  const std::int64_t side = patches.shape[1];
  file.require(side == patches.shape[2] && side >= 1 && side <= 1000, "patches: {} x {}", side,
               patches.shape[2]);
  if (!file.reads()) return;
  const auto size = static_cast<int>(side);
  for (std::int64_t i = 0; i < n; ++i) {
    cv::Mat patch(size, size, CV_32FC1);
    std::copy_n(patches.values.begin() + i * side * side, side * side, patch.ptr<float>());
    model.patches.push_back(patch);
  }
}

}  // namespace

nlohmann::json to_json(const PatchModels& model) {
  model.check();
  return linalg::written(model, list_patches);
}

PatchModels patch_models_from_json(const nlohmann::json& value, const std::string& path) {
  return linalg::read_checked<PatchModels>(value, path, list_patches);
}

}  // namespace tarsier::face::regression
