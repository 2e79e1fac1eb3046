// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/reconstructor.h"
#include "tarsier/synth/sfm_scene.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "bench.h"
#include "framework/size_flag.h"
#include "scratch.h"
#include <algorithm>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMaxRuns = 3;  // per set; each takes many seconds

// The input of a reconstruction: files, and the lens and camera positions if known.
struct ImageSet {
  std::string name;
  std::vector<std::string> sources;
  std::optional<geometry::Camera> camera;
  sfm::PoseTruth truth;
};

// Images of a ring around a synthetic scene.
ImageSet drawn_ring(int images, cv::Size size, const Scratch& scratch, const Context& context) {
  synth::SceneOptions options;
  options.seed = context.seed;
  options.size = size;
  options.images = images;
  options.trajectory = synth::Trajectory::kRing;
  const synth::SfmScene scene(options);
  ImageSet set;
  set.name = fmt::format("ring{} {}x{}", images, size.width, size.height);
  set.camera = scene.camera();
  for (int i = 0; i < images; ++i) {
    const std::string name = fmt::format("{}-{}x{}-{:04}.jpg", images, size.width, size.height, i);
    set.sources.push_back(scratch / name);
    write_image(set.sources.back(), scene.render(i, context.stop), 95);
    set.truth[name] = scene.pose(i);
  }
  return set;
}

// Times of the runs of a set, and the result, which is identical for all runs.
struct Runs {
  std::map<std::string, std::vector<double>> wall_s;  // of each stage
  std::map<std::string, std::vector<double>> cpu_s;
  std::vector<std::string> stages;  // in order
  sfm::PipelineResult result;
};

Runs run(const ImageSet& set, int repeats, const Context& context) {
  sfm::ReconstructorOptions options;  // without a folder nothing is kept between runs
  options.cache = false;
  options.pipeline.camera = set.camera;
  options.pipeline.seed = context.seed;
  const sfm::Reconstructor reconstructor(options);
  Runs runs;
  NoProgress progress;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    runs.result = reconstructor.run(set.sources, progress, context.stop).pipeline;
    double wall = 0;
    double cpu = 0;
    for (const sfm::StageTime& stage : runs.result.stages) {
      runs.wall_s[stage.name].push_back(stage.seconds);
      runs.cpu_s[stage.name].push_back(stage.cpu_seconds);
      wall += stage.seconds;
      cpu += stage.cpu_seconds;
      if (repeat == 0) runs.stages.push_back(stage.name);
    }
    runs.wall_s["all"].push_back(wall);
    runs.cpu_s["all"].push_back(cpu);
  }
  runs.stages.emplace_back("all");
  return runs;
}

// The counts of a stage's results.
Json counts_of(const std::string& stage, const sfm::PipelineResult& result) {
  const auto& models = result.reconstruction.models;
  Json counts;
  if (stage == "features") {
    std::int64_t features = 0;
    for (const sfm::ImageReport& image : result.images) features += image.features;
    counts = {{"images", result.images.size()}, {"features", features}};
  } else if (stage == "pairs") {
    counts = {{"pairs", result.compared}};
  } else if (stage == "match") {
    std::int64_t matches = 0;
    std::size_t inliers = 0;
    for (const sfm::Pair& pair : result.pairs) {
      matches += pair.matches;
      inliers += pair.view.inliers.size();
    }
    counts = {{"pairs", result.verified}, {"matches", matches}, {"inliers", inliers}};
  } else if (stage == "all") {
    counts = {{"images", result.images.size()}};
  } else if (!models.empty()) {
    const sfm::ModelStatistics statistics = sfm::statistics_of(models[0]);
    counts = {{"models", models.size()},
              {"registered", statistics.registered},
              {"points", models[0].points.size()},
              {"observations", statistics.observations}};
  } else {
    counts = {{"models", 0}};
  }
  return counts;
}

// Mean error of the camera centres, in per cent of the extent of the true centres.
std::optional<double> center_percent(const ImageSet& set, const sfm::PipelineResult& result) {
  if (set.truth.empty() || result.reconstruction.models.empty() ||
      sfm::statistics_of(result.reconstruction.models[0]).registered < 3)
    return std::nullopt;
  const sfm::PoseScores scores =
      sfm::evaluate_poses(result.reconstruction.models[0], set.truth, set.name);
  return 100 * scores.center_mean / scores.extent;
}

void report(const ImageSet& set, const Runs& runs, const Context& context) {
  for (const std::string& stage : runs.stages) {
    const double cpu_s = upper_median(runs.cpu_s.at(stage));
    const double wall_s = upper_median(runs.wall_s.at(stage));
    Json counts = counts_of(stage, runs.result);
    if (stage == "all") {
      if (const auto percent = center_percent(set, runs.result))
        counts["center_percent"] = rounded(*percent, 4);
    }
    if (context.json) {
      Json line{{"bench", "sfm"},
                {"case", fmt::format("{} {}", set.name, stage)},
                {"set", set.name},
                {"stage", stage},
                {"cpu_ms", rounded(1e3 * cpu_s, 1)},
                {"wall_ms", rounded(1e3 * wall_s, 1)}};
      line.update(counts);
      print_json(line);
      continue;
    }
    std::string text;
    for (const auto& [name, value] : counts.items())
      text += fmt::format("  {} {}", name, value.dump());
    print_text(fmt::format("{:16} {:12} {:8.2f} CPU s {:8.2f} s{}\n", set.name, stage, cpu_s,
                           wall_s, text));
  }
}

}  // namespace

ExitStatus bench_sfm(Context& context, const BenchOptions& options) {
  const int repeats = std::clamp(options.repeats, 1, kMaxRuns);
  if (!options.inputs.empty()) {
    const ImageSet given{"images", options.inputs, {}, {}};
    report(given, run(given, repeats, context), context);
    return ExitStatus::kDone;
  }
  const std::vector<std::string> sizes =
      options.sizes.empty() ? std::vector<std::string>{"640x480"} : options.sizes;
  const Scratch scratch;
  for (const std::string& text : sizes) {
    const cv::Size size = parse_size(text, 64, 8192);
    for (const int images : {12, 60}) {
      if (!is_chosen(options, fmt::format("ring{}", images))) continue;
      const ImageSet set = drawn_ring(images, size, scratch, context);
      report(set, run(set, repeats, context), context);
    }
  }
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
