// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/report.h"

#include "tarsier/core/rounding.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/start_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

using OrderedJson = nlohmann::ordered_json;

// share of the extent: a larger uncertainty of a centre is reported
constexpr double kUncertain = 0.01;

OrderedJson camera_json(const geometry::Camera& camera) {
  OrderedJson distortion = OrderedJson::array();
  for (const double k : camera.coefficients()) distortion.push_back(rounded_to_steps(k, 1e8));
  return {{"width", camera.width},
          {"height", camera.height},
          {"fx", rounded_to_steps(camera.fx, 1e4)},
          {"fy", rounded_to_steps(camera.fy, 1e4)},
          {"cx", rounded_to_steps(camera.cx, 1e4)},
          {"cy", rounded_to_steps(camera.cy, 1e4)},
          {"lens", geometry::name_of(camera.lens)},
          {"distortion", distortion}};
}

OrderedJson model_json(const Model& model) {
  const ModelStatistics statistics = statistics_of(model);
  std::vector<bool> used(model.cameras.size(), false);
  for (const Image& image : model.images)
    if (image.registered) used[static_cast<std::size_t>(image.camera)] = true;
  OrderedJson cameras = OrderedJson::array();
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k]) cameras.push_back(camera_json(model.cameras[k]));
  return {{"images", statistics.registered},
          {"points", model.points.size()},
          {"observations", statistics.observations},
          {"mean_track", rounded_to_steps(statistics.mean_track, 1e3)},
          {"reprojection_px", rounded_to_steps(statistics.reprojection_px, 1e4)},
          {"cameras", std::move(cameras)}};
}

OrderedJson joins_json(const Reconstruction& built) {
  OrderedJson joins = OrderedJson::array();
  for (const ModelJoin& join : built.joins) {
    OrderedJson entry{{"parts",
                       {built.parts[static_cast<std::size_t>(join.first)],
                        built.parts[static_cast<std::size_t>(join.second)]}},
                      {"joined", join.refusal.empty()},
                      {"images", join.images},
                      {"images_agree", join.agreeing},
                      {"points", join.points},
                      {"points_agree", join.inliers},
                      {"rotation_deg", rounded_to_steps(join.rotation_deg, 1e4)},
                      {"scale", rounded_to_steps(join.first_from_second.scale, 1e6)},
                      {"scale_error", rounded_to_steps(join.scale_error, 1e6)}};
    if (!join.refusal.empty()) entry["reason"] = join.refusal;
    joins.push_back(std::move(entry));
  }
  return joins;
}

const CenterUncertainty* uncertainty_of(const Reconstruction& built, std::size_t model) {
  if (model >= built.uncertainties.size()) return nullptr;
  const std::optional<CenterUncertainty>& uncertainty = built.uncertainties[model];
  return uncertainty ? &*uncertainty : nullptr;
}

// Number of model points that each image observes.
std::vector<int> observed_points(const Model& model) {
  std::vector<int> point_counts(model.images.size(), 0);
  for (std::size_t i = 0; i < model.images.size(); ++i)
    point_counts[i] =
        static_cast<int>(std::count_if(model.images[i].points.begin(), model.images[i].points.end(),
                                       [](int point) { return point >= 0; }));
  return point_counts;
}

}  // namespace

nlohmann::ordered_json report_json(const PipelineResult& result) {
  const Reconstruction& built = result.reconstruction;
  OrderedJson models = OrderedJson::array();
  std::vector<std::vector<int>> point_counts;
  for (const Model& model : built.models) {
    models.push_back(model_json(model));
    const std::size_t m = models.size() - 1;
    if (m < built.trust.size()) models.back()["trust"] = rounded_to_steps(built.trust[m], 1e3);
    if (m < built.shapes.size()) {
      const ModelShape& shape = built.shapes[m];
      if (std::isfinite(shape.weakest_joint))
        models.back()["weakest_joint"] = rounded_to_steps(shape.weakest_joint, 1e3);
      models.back()["missed_pairs"] = shape.missed_pairs.size();
      models.back()["missing_places"] = shape.missing_places;
    }
    if (const CenterUncertainty* uncertainty = uncertainty_of(built, m)) {
      models.back()["center_sigma_percent"] = rounded_to_steps(100 * uncertainty->mean, 1e4);
      models.back()["center_sigma_worst_percent"] = rounded_to_steps(100 * uncertainty->worst, 1e4);
    }
    point_counts.push_back(observed_points(model));
  }
  OrderedJson images = OrderedJson::array();
  std::size_t index = 0;  // among the readable images
  for (const ImageReport& report : result.images) {
    OrderedJson entry{{"name", report.name}};
    if (result.names_files && !report.path.empty())
      entry["file"] = std::filesystem::absolute(report.path).string();
    entry["registered"] = report.outcome.registered;
    if (report.outcome.registered) {
      entry["model"] = report.outcome.model;
      if (!built.trust.empty()) entry["trust"] = rounded_to_steps(report.outcome.trust, 1e3);
      const auto m = static_cast<std::size_t>(report.outcome.model);
      entry["points"] = point_counts[m][index];
      if (const CenterUncertainty* uncertainty = uncertainty_of(built, m))
        entry["center_sigma_percent"] = rounded_to_steps(100 * uncertainty->sigmas[index], 1e4);
    } else {
      entry["reason"] = report.outcome.reason;
    }
    entry["read"] = report.read;
    if (report.read) {
      entry["features"] = report.features;
      entry["focal_from"] = report.focal_from;
      ++index;
    }
    images.push_back(std::move(entry));
  }
  OrderedJson refused = OrderedJson::array();
  std::vector<std::string> names;  // of the readable images
  for (const ImageReport& report : result.images)
    if (report.read) names.push_back(report.name);
  for (const RefusedPair& pair : built.refused)
    refused.push_back({{"images",
                        {names[static_cast<std::size_t>(pair.first)],
                         names[static_cast<std::size_t>(pair.second)]}},
                       {"inliers", pair.inliers},
                       {"reason", pair.reason}});
  OrderedJson stages = OrderedJson::array();
  for (const StageTime& stage : result.stages)
    stages.push_back({{"name", stage.name},
                      {"seconds", rounded_to_steps(stage.seconds, 1e3)},
                      {"cpu_seconds", rounded_to_steps(stage.cpu_seconds, 1e3)}});
  OrderedJson report{{"models", std::move(models)},
                     {"images", std::move(images)},
                     {"pairs",
                      {{"compared", result.compared},
                       {"verified", result.verified},
                       {"refused", std::move(refused)}}},
                     {"from_cache", result.from_cache},
                     {"stages", std::move(stages)},
                     {"log", built.log}};
  if (result.start) {
    OrderedJson start{{"images", result.start->images},
                      {"here", result.start->in_inputs},
                      {"registered", result.start->registered},
                      {"fixed_poses", result.start->fixed_poses}};
    if (result.names_files)
      start["folder"] = std::filesystem::absolute(result.start->folder).string();
    report["start_model"] = std::move(start);
  }
  if (!built.parts.empty()) {
    report["parts"] = built.parts;
    report["joins"] = joins_json(built);
  }
  if (built.interrupted) report["partial"] = true;
  if (result.resumed > 0) report["resumed"] = result.resumed;
  if (!built.no_model.empty()) report["no_model"] = built.no_model;
  return report;
}

std::string summary_text(const PipelineResult& result) {
  const Reconstruction& built = result.reconstruction;
  std::string text;
  if (built.interrupted)
    text += "partial: the run was interrupted; run the same command to resume\n";
  if (result.start) {
    text +=
        fmt::format("start model: {} of {} images{}\n", result.start->registered,
                    result.start->images, result.start->fixed_poses ? ", with fixed poses" : "");
  }
  for (std::size_t m = 0; m < built.models.size(); ++m) {
    const ModelStatistics statistics = statistics_of(built.models[m]);
    text += fmt::format(
        "model {}: {} of {} images, {} points, each in {:.1f} images, reprojection error "
        "{:.2f} px\n",
        m, statistics.registered, result.images.size(), built.models[m].points.size(),
        statistics.mean_track, statistics.reprojection_px);
    if (m < built.trust.size() && built.trust[m] < 0.5)
      text += fmt::format(
          "model {}: the images support it only weakly (trust {:.2f}): see report.json\n", m,
          built.trust[m]);
    const CenterUncertainty* uncertainty = uncertainty_of(built, m);
    if (uncertainty != nullptr && uncertainty->worst >= kUncertain)
      text += fmt::format(
          "model {}: the most uncertain camera centre has a standard deviation of {:.1f} % of the "
          "extent\n",
          m, 100 * uncertainty->worst);
  }
  if (built.models.empty()) text += "no model: " + built.no_model + "\n";
  for (const ModelJoin& join : built.joins)
    if (!join.refusal.empty())
      text += fmt::format("not joined: {} and {}: {}\n",
                          built.parts[static_cast<std::size_t>(join.first)],
                          built.parts[static_cast<std::size_t>(join.second)], join.refusal);
  if (!built.refused.empty())
    text += fmt::format("{} image pairs were rejected: see \"refused\" in report.json\n",
                        built.refused.size());
  for (const ImageReport& report : result.images)
    if (!report.outcome.registered)
      text += fmt::format("not registered: {}: {}\n", report.name, report.outcome.reason);
  text += "seconds:";
  for (const StageTime& stage : result.stages)
    text += fmt::format(" {} {:.1f}", stage.name, stage.seconds);
  return text + "\n";
}

}  // namespace tarsier::sfm
