// SPDX-License-Identifier: MIT
#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/pipelines/pose_evaluation.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/format.h>

#include "verbs/pose/pose.h"
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct PoseEvalFlags {
  PoseFlags pose;
  std::string pointing;
  std::string truth;
  std::string results;
  std::string compare;
  std::string output;
  std::string csv;
  bool occlude = false;
};

std::string table_of(const std::vector<face::head::PointingOutcome>& outcomes) {
  std::string table =
      "image,tilt,pan,seen,found,pitch,yaw,roll,pitch_sigma_deg,yaw_sigma_deg,roll_sigma_deg\n";
  for (const face::head::PointingOutcome& o : outcomes) {
    const face::head::HeadAngles a =
        o.rotation ? face::head::angles_of_rotation(*o.rotation) : face::head::HeadAngles{};
    const Eigen::Vector3d s = o.sigma_deg.value_or(Eigen::Vector3d::Zero());
    table +=
        fmt::format("{},{:g},{:g},{:d},{:d},{:.2f},{:.2f},{:.2f},{:.2f},{:.2f},{:.2f}\n",
                    csv_field(o.image), o.truth.tilt_deg, o.truth.pan_deg, o.face_detected,
                    o.rotation.has_value(), a.pitch_deg, a.yaw_deg, a.roll_deg, s[1], s[0], s[2]);
  }
  return table;
}

bool evaluate_pointing(const PoseEvalFlags& flags, face::PoseEvaluator& evaluator,
                       Context& context) {
  const std::vector<face::head::PointingOutcome> outcomes =
      evaluator.pointing(face::pointing_images(flags.pointing), *context.progress, context.stop);
  if (!flags.csv.empty()) write_file_atomically(flags.csv, table_of(outcomes));
  const face::head::PointingScore score = face::head::score_pointing(outcomes);
  print_pointing(score, context, "");
  return score.with_pose > 0;
}

void print_score(const face::head::PoseScore& score, const Context& context) {
  if (context.json) {
    nlohmann::ordered_json line;
    line["set"] = "truth";
    line["images"] = score.truths;
    line["answered"] = score.with_pose;
    line["pitch_mae"] = rounded(score.pitch_mae_deg, 3);
    line["yaw_mae"] = rounded(score.yaw_mae_deg, 3);
    line["roll_mae"] = rounded(score.roll_mae_deg, 3);
    line["rotation_mean"] = rounded(score.mean_deg, 3);
    line["rotation_median"] = rounded(score.median_deg, 3);
    line["rotation_p95"] = rounded(score.p95_deg, 3);
    line["beyond10"] = rounded(score.over_10_deg, 3);
    if (score.with_translation > 0) {
      line["translation_mean"] = rounded(score.translation_mean_mm, 3);
      line["translation_median"] = rounded(score.translation_median_mm, 3);
      line["translation_percent"] = rounded(score.translation_percent, 3);
    }
    add_coverage(score.coverage, line);
    add_coverage(score.image_coverage, line, "_image");
    print_json(line);
    return;
  }
  print_text(fmt::format(
      "answered {}/{}  MAE pitch {:.2f} yaw {:.2f} roll {:.2f} mean {:.2f} degrees | rotation mean "
      "{:.2f} median {:.2f} p95 {:.2f}, beyond 10 degrees {:.1f} %\n",
      score.with_pose, score.truths, score.pitch_mae_deg, score.yaw_mae_deg, score.roll_mae_deg,
      (score.pitch_mae_deg + score.yaw_mae_deg + score.roll_mae_deg) / 3, score.mean_deg,
      score.median_deg, score.p95_deg, 100 * score.over_10_deg));
  if (score.with_translation > 0) {
    print_text(fmt::format("translation mean {:.2f} median {:.2f} ({:.2f} % of the distance)\n",
                           score.translation_mean_mm, score.translation_median_mm,
                           score.translation_percent));
  }
  print_text(coverage_text(score.coverage));
  print_text(coverage_text(score.image_coverage, " of the image (without the floor)"));
}

ExitStatus run_pose_eval(const PoseEvalFlags& flags, Context& context) {
  if (flags.pointing.empty() && flags.truth.empty() && flags.compare.empty()) {
    throw UsageError("give --pointing DIR, --truth FILE or --compare FILE");
  }
  if (flags.occlude && (flags.truth.empty() || !flags.results.empty()))
    throw UsageError("--occlude evaluates poses estimated in images: needs --truth, not --results");
  if (!flags.results.empty() && flags.truth.empty()) {
    throw UsageError("--results needs --truth FILE");
  }
  bool any = false;
  if (!flags.compare.empty()) {
    const face::head::HeadComparison comparison =
        face::head::compare_head(read_head(flags.pose.head), flags.compare);
    any = true;
    if (context.json) {
      nlohmann::ordered_json line{{"set", "compare"}, {"all_mm", rounded(comparison.all_mm, 3)}};
      if (comparison.inner_mm > 0) line["inner51_mm"] = rounded(comparison.inner_mm, 3);
      print_json(line);
    } else {
      print_text(fmt::format("mean head against {}: {:.2f} mm over all points", flags.compare,
                             comparison.all_mm));
      if (comparison.inner_mm > 0) {
        print_text(fmt::format(", {:.2f} mm over the inner 51", comparison.inner_mm));
      }
      print_text("\n");
    }
  }
  std::optional<face::PoseEvaluator> evaluator;
  if (!flags.pointing.empty() || (!flags.truth.empty() && flags.results.empty())) {
    const face::PoseTrackerOptions options = pose_options(flags.pose);
    evaluator.emplace(load_pose_models(options), options);
  }
  if (!flags.pointing.empty()) any = evaluate_pointing(flags, *evaluator, context) || any;
  if (!flags.truth.empty()) {
    const std::vector<face::head::PoseLine> truth = face::head::read_pose_lines(flags.truth);
    const std::vector<face::head::PoseLine> found =
        flags.results.empty() ? evaluator->poses(flags.truth, truth, {flags.occlude, context.seed},
                                                 *context.progress, context.stop)
                              : face::head::read_pose_lines(flags.results);
    const face::head::PoseScore score = face::head::score_poses(
        face::head::match_poses(found, truth), static_cast<int>(truth.size()));
    print_score(score, context);
    any = any || score.with_pose > 0;
  }
  if (evaluator && !flags.output.empty()) write_file_atomically(flags.output, evaluator->lines());
  return any ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

void add_flags(Command& verb, PoseEvalFlags& flags) {
  add_pose_flags(verb, flags.pose);
  verb.add_option("--pointing", flags.pointing,
                  "folder of the Pointing'04 head pose set; file names contain the angles");
  verb.add_option("--truth", flags.truth,
                  "JSON lines {\"image\", \"rotation\": [9 numbers] or \"R\" or \"euler\": [pitch, "
                  "yaw, roll] (BIWI), \"translation\": mm (optional)}");
  verb.add_option("--results", flags.results,
                  "evaluate these JSON lines (of `pose track --json`) instead of the models");
  verb.add_option("--compare", flags.compare, "file of 3D landmarks to compare the mean head with");
  verb.add_flag("--occlude", flags.occlude,
                "occlude each face of --truth by a drawn object (by --seed)");
  verb.add_option("-o,--output", flags.output, "output file of the estimated poses, JSON lines");
  verb.add_option("--csv", flags.csv, "CSV file of --pointing, one row an image");
}

}  // namespace

void add_pose_eval(Command& area, Context& context) {
  add_verb<PoseEvalFlags>(area, "eval", "evaluate head poses against ground truth", context,
                          add_flags, run_pose_eval);
}

}  // namespace tarsier::cli
