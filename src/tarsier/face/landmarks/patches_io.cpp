// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/landmarks/patches.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::face::landmarks {
namespace {

constexpr std::array<std::pair<PatchMethod, const char*>, 3> kMethods{
    {{PatchMethod::kStochastic, "stochastic"},
     {PatchMethod::kRidge, "ridge"},
     {PatchMethod::kAverage, "average"}}};

constexpr std::int64_t kMaxPoints = 10'000;

}  // namespace

nlohmann::json to_json(const PatchModels& model) {
  model.check();
  const std::int64_t n = model.points();
  const std::int64_t side = model.side();
  PackedArray<float> patches{{n, side, side}, {}};
  patches.values.reserve(static_cast<std::size_t>(n * side * side));
  for (const cv::Mat& patch : model.patches)
    patches.values.insert(patches.values.end(), patch.ptr<float>(),
                          patch.ptr<float>() + patch.total());
  const auto* method = std::find_if(kMethods.begin(), kMethods.end(),
                                    [&](const auto& entry) { return entry.first == model.method; });
  return {{"method", method->second},
          {"reference",
           pack(PackedArray<double>{
               {n, 2}, {model.reference.data(), model.reference.data() + model.reference.size()}})},
          {"patches", pack(patches)}};
}

PatchModels patch_models_from_json(const nlohmann::json& value, const std::string& path) {
  PatchModels model;
  const std::string name = text_member(value, "method", path, 20);
  const auto* method = std::find_if(kMethods.begin(), kMethods.end(),
                                    [&](const auto& entry) { return name == entry.second; });
  if (method == kMethods.end())
    throw ModelError(path, "method: is none of stochastic, ridge, average");
  model.method = method->first;
  const PackedArray<double> reference =
      unpack<double>(member(value, "reference", path), path, "reference", {-1, 2});
  const std::int64_t n = reference.shape[0];
  if (n < 1 || n > kMaxPoints)
    throw ModelError(path, fmt::format("reference: {} points, not 1..{}", n, kMaxPoints));
  const PackedArray<float> patches =
      unpack<float>(member(value, "patches", path), path, "patches", {n, -1, -1});
  const std::int64_t side = patches.shape[1];
  if (side != patches.shape[2] || side < 1 || side > 1000)
    throw ModelError(path, fmt::format("patches: {} x {}", side, patches.shape[2]));
  model.reference = Eigen::Map<const Eigen::Matrix2Xd>(reference.values.data(), 2, n);
  const auto size = static_cast<int>(side);
  for (std::int64_t i = 0; i < n; ++i) {
    cv::Mat patch(size, size, CV_32FC1);
    std::copy_n(patches.values.begin() + i * side * side, side * side, patch.ptr<float>());
    model.patches.push_back(patch);
  }
  return checked(std::move(model), path);
}

}  // namespace tarsier::face::landmarks
