// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/dense_reconstructor.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rounding.h"
#include "tarsier/sfm/dense/dense_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
std::optional<DenseQuality> dense_quality_named(std::string_view name) {
  if (name == "draft") return DenseQuality::kDraft;
  if (name == "normal") return DenseQuality::kNormal;
  if (name == "high") return DenseQuality::kHigh;
  return std::nullopt;
}

DenseOptions dense_options(DenseQuality quality) {
  DenseOptions options;
  switch (quality) {
    case DenseQuality::kDraft:
      options.reduce = 4;
      options.min_side = 320;
      options.views.views = 4;
      options.matching.geometric_rounds = 0;
      break;
    case DenseQuality::kNormal:
      break;
    case DenseQuality::kHigh:
      options.reduce = 1;
      options.views.views = 8;
      options.matching.fine_rounds = 2;
      options.matching.geometric_rounds = 2;
      break;
  }
  return options;
}

void DenseOptions::check() const {
  check_fields(*this);
  views.check();
  matching.check();
  filter.check();
  fusion.check();
  TARSIER_REQUIRE(min_depth == 0 || max_depth == 0 || min_depth < max_depth,
                  "min_depth {} is not below max_depth {}", min_depth, max_depth);
}

nlohmann::ordered_json to_json(const DenseResult& result) {
  nlohmann::ordered_json images = nlohmann::ordered_json::array();
  for (const DenseImage& image : result.images) {
    nlohmann::ordered_json entry{{"name", image.name}, {"sources", image.sources}};
    if (image.reason.empty()) {
      entry["width"] = image.size.width;
      entry["height"] = image.size.height;
      entry["known"] = rounded_to_steps(image.known, 1e4);
      entry["median_cost"] = rounded_to_steps(image.median_cost, 1e4);
      entry["sparse_known"] = rounded_to_steps(image.sparse_known, 1e4);
      entry["sparse_within"] = rounded_to_steps(image.sparse_within, 1e4);
      entry["points"] = image.points;
      entry["cpu_seconds"] = rounded_to_steps(image.cpu_seconds, 1e2);
    } else {
      entry["reason"] = image.reason;
    }
    images.push_back(std::move(entry));
  }
  return {{"images", std::move(images)},
          {"points", result.points},
          {"cpu_seconds", rounded_to_steps(result.cpu_seconds, 1e2)}};
}

std::string summary_text(const DenseResult& result) {
  int with_depths = 0;
  int reused = 0;
  double known = 0;
  for (const DenseImage& image : result.images) {
    if (!image.reason.empty()) continue;
    ++with_depths;
    known += image.known;
    if (image.is_reused) ++reused;
  }
  std::string text = fmt::format(
      "{} of {} images have depth maps, with depths for {:.0f} % of the pixels; {} points\n",
      with_depths, result.images.size(), with_depths > 0 ? 100 * known / with_depths : 0.0,
      result.points);
  if (reused > 0)
    text += fmt::format("{} of the depth maps were computed by an earlier run\n", reused);
  for (const DenseImage& image : result.images)
    if (!image.reason.empty()) text += fmt::format("left out: {}: {}\n", image.name, image.reason);
  return text + fmt::format("cpu seconds: {:.1f}\n", result.cpu_seconds);
}

DenseReconstructor::DenseReconstructor(const DenseOptions& options) : options_(options) {
  options_.check();
}

DenseResult DenseReconstructor::run(const DenseJob& job, Progress& progress,
                                    const std::stop_token& stop, DebugSink* debug) const {
  return run_dense(options_, job, progress, stop, debug);
}

}  // namespace tarsier::sfm
