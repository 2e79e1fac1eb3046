// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/image_targets/evaluate.h"
#include "tarsier/planar/markers/evaluation.h"
#include "tarsier/planar/pipelines/marker_tracker.h"

#include <fmt/format.h>

#include "verbs/ar/ar.h"
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct MarkerEvalFlags {
  std::string truth;
  std::string family;
  std::string backend = "own";
  std::string results;
  std::string output;
  double tolerance = 0.2;
  planar::image_targets::PlanarOptions planar;
};

// Detects the markers in the image of a line.
planar::MarkerResult find_markers(const planar::markers::MarkerTruth& truth,
                                  const MarkerEvalFlags& flags, planar::MarkerState& state) {
  planar::MarkerTrackerOptions options;
  options.families = {truth.family};
  options.side = truth.size;
  options.camera = truth.camera;
  if (flags.backend == "opencv") options.detector = planar::MarkerDetector::kOpencv;
  Frame frame;
  frame.name = (fs::path(flags.truth).parent_path() / truth.image).string();
  frame.image = read_gray_image(frame.name);
  frame.still = true;
  return planar::MarkerTracker::load(options).process(frame, state);
}

void print_score(const std::string& set, const planar::markers::MarkerScore& score,
                 const Context& context) {
  if (context.json) {
    Json line{{"set", set}, {"images", score.images}, {"truth", score.truth}};
    line["recall"] = rounded(score.recall(), 4);
    line["precision"] = rounded(score.precision(), 4);
    line["wrong"] = score.false_positives;
    line["wrong_order"] = score.rotated;
    const auto add = [&](const char* name, double value) {
      line[name] = std::isfinite(value) ? Json(rounded(value, 4)) : Json(nullptr);
    };
    add("corner_rmse_median", score.corner_px);
    add("corner_rmse_p95", score.corner_px_p95);
    add("rot_deg_median", score.rotation_deg);
    add("rot_deg_p95", score.rotation_deg_p95);
    add("flips_pct", score.flips_percent);
    add("t_pct_median", score.distance_percent);
    add("ms_median", score.ms);
    Json levels = Json::object();
    for (const auto& [level, counts] : score.levels)
      levels[level] = rounded(counts.second > 0 ? 1.0 * counts.first / counts.second : 1, 4);
    line["recall_by_level"] = levels;
    print_json(line);
    return;
  }
  const auto number = [](double value, int digits) {
    return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : std::string("-");
  };
  print_text(fmt::format(
      "{:16} {} images, {} there: recall {:.3f}, precision {:.3f} ({} wrong) | corners {} px, "
      "p95 {} | rotation {} degrees, p95 {}, flips {} % | distance {} % | {} ms\n",
      set, score.images, score.truth, score.recall(), score.precision(), score.false_positives,
      number(score.corner_px, 3), number(score.corner_px_p95, 2), number(score.rotation_deg, 2),
      number(score.rotation_deg_p95, 1), number(score.flips_percent, 1),
      number(score.distance_percent, 2), number(score.ms, 2)));
}

// The markers of the lines whose truth names an image.
std::map<std::string, planar::markers::ImageDetections> find_images(const MarkerEvalFlags& flags,
                                                                    Context& context,
                                                                    std::string& lines) {
  std::map<std::string, planar::markers::ImageDetections> found;
  planar::image_targets::evaluate_planar(
      flags.truth, flags.planar,
      [&](const planar::image_targets::PlanarResult& result) {
        context.progress->advance();
        planar::markers::ImageDetections& entry = found[result.image];
        entry.ms = result.ms;
        for (const planar::image_targets::DetectedTarget& one : result.found) {
          planar::markers::MarkerRecord& marker = entry.markers.emplace_back();
          marker.corners = one.corners;
          if (one.poses) marker.pose = one.poses->best.camera_from_plane;
        }
        lines +=
            Json{
                {"image", result.image}, {"markers", result.markers}, {"ms", rounded(result.ms, 2)}}
                .dump() +
            "\n";
      },
      context.stop);
  return found;
}

std::map<std::string, planar::markers::ImageDetections> find_all(
    const MarkerEvalFlags& flags, const std::vector<planar::markers::MarkerTruth>& truth,
    Context& context, std::string& lines) {
  if (!flags.results.empty()) return planar::markers::read_detected_markers(flags.results);
  context.progress->begin("images", static_cast<std::int64_t>(truth.size()), "images");
  std::map<std::string, planar::markers::ImageDetections> found;
  if (!truth.front().target.empty()) {
    found = find_images(flags, context, lines);
  } else {
    planar::MarkerState state;
    for (const planar::markers::MarkerTruth& line : truth) {
      throw_if_stopped(context.stop);
      const planar::MarkerResult result = find_markers(line, flags, state);
      context.progress->advance();
      Json object{{"image", line.image}};
      object.update(to_json(result));
      lines += object.dump() + "\n";
      planar::markers::ImageDetections& entry = found[line.image];
      entry = {{}, result.ms};
      for (const planar::TrackedMarker& one : result.markers)
        entry.markers.push_back(planar::markers::record_of(one.marker, one.pose));
    }
  }
  context.progress->end();
  return found;
}

ExitStatus run_marker_eval(const MarkerEvalFlags& flags, Context& context) {
  std::vector<planar::markers::MarkerTruth> truth = planar::markers::read_marker_truth(flags.truth);
  const bool has_images = !truth.front().target.empty();
  for (const planar::markers::MarkerTruth& line : truth) {
    if (line.target.empty() == has_images)
      throw InputError(
          flags.truth,
          "has lines of markers and of image targets: a file may contain only one kind");
    if (!has_images) (void)planar::markers::find_dictionary(line.family);
  }
  if (!flags.family.empty()) {
    if (has_images) throw UsageError("--family is for truth with markers");
    std::erase_if(truth, [&](const auto& line) {
      return line.family != flags.family &&
             planar::markers::find_dictionary(line.family).name() !=
                 planar::markers::find_dictionary(flags.family).name();
    });
    if (truth.empty())
      throw InputError(flags.truth, fmt::format("has no lines of the family {}", flags.family));
  }
  std::string lines;
  const auto found = find_all(flags, truth, context, lines);
  planar::markers::MarkerEvaluator all(flags.tolerance);
  std::map<std::string, planar::markers::MarkerEvaluator> sets;
  int answered = 0;
  for (const planar::markers::MarkerTruth& line : truth) {
    const auto one = found.find(line.image);
    static const planar::markers::ImageDetections kNothing;
    const planar::markers::ImageDetections& result = one == found.end() ? kNothing : one->second;
    answered += static_cast<int>(result.markers.size());
    sets.try_emplace(has_images ? "images" : line.family, flags.tolerance)
        .first->second.add(line, result.markers, result.ms);
    all.add(line, result.markers, result.ms);
  }
  for (const auto& [name, evaluator] : sets) print_score(name, evaluator.score(), context);
  if (sets.size() > 1) print_score("all", all.score(), context);
  if (!flags.output.empty()) write_file_atomically(flags.output, lines);
  return answered > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

void add_flags(Command& verb, MarkerEvalFlags& flags) {
  verb.add_option("truth", flags.truth,
                  "ground truth: JSON lines {\"image\", \"family\" or \"target\", \"K\", \"size\", "
                  "\"markers\"}")
      .required();
  verb.add_option("--family", flags.family, "evaluate only lines of this family");
  Flag& backend =
      verb.add_option("--backend", flags.backend, "own, or opencv for comparison (markers)")
          .check(one_of({"own", "opencv"}))
          .show_default();
  Flag& results =
      verb.add_option("--results", flags.results,
                      "evaluate these JSON lines {\"image\", \"markers\"} instead of detecting");
  results.excludes(backend);
  verb.add_option(
          "--tolerance", flags.tolerance,
          "maximum mean corner error of a correct detection, share of the side; at least 3 px")
      .check(range(0.01, 1.0))
      .show_default();
  verb.add_option("-o,--output", flags.output, "output file of the detections, JSON lines")
      .excludes(results);
}

}  // namespace

void add_ar_eval(Command& ar, Context& context) {
  add_verb<MarkerEvalFlags>(ar, "eval",
                            "evaluate detection and pose against ground truth (of `ar synth`)",
                            context, add_flags, run_marker_eval);
}

}  // namespace tarsier::cli
