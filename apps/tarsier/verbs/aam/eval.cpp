// SPDX-License-Identifier: MIT
#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/appearance/study.h"
#include "tarsier/face/landmarks/evaluation.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "framework/stopwatch.h"
#include "verbs/aam/aam.h"
#include "verbs/landmarks/landmarks.h"
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct AamEvalFlags {
  SetFlags set;
  AamFlags aam;
  int held_out = 0;
  double limit = 4;
  std::string output;
  std::string csv;
  std::string convergence;
  int tries = 5;
  std::vector<int> eyes;
};

std::string line_of(const std::string& image, const std::optional<Eigen::Matrix2Xd>& points,
                    double ms) {
  nlohmann::ordered_json line{{"image", image}};
  if (points) {
    nlohmann::json list = nlohmann::json::array();
    for (Eigen::Index i = 0; i < points->cols(); ++i)
      list.push_back({rounded((*points)(0, i), 4), rounded((*points)(1, i), 4)});
    line["points"] = std::move(list);
  }
  line["ms"] = rounded(ms, 2);
  return json_text(line) + "\n";
}

// The object whose points are nearest to the centre of the ground truth, because images may contain
// other objects.
const face::appearance::TrackedObject* nearest_object(
    const std::vector<face::appearance::TrackedObject>& objects, const Eigen::Matrix2Xd& truth) {
  const face::appearance::TrackedObject* best = nullptr;
  double min_distance = 0;
  for (const face::appearance::TrackedObject& object : objects) {
    const double distance = (object.fit.points.rowwise().mean() - truth.rowwise().mean()).norm();
    if (best != nullptr && distance >= min_distance) continue;
    best = &object;
    min_distance = distance;
  }
  return best;
}

ExitStatus convergence(const AamEvalFlags& flags, const face::shape::LandmarkSet& set,
                       const face::AppearanceTracker& tracker, Context& context) {
  face::appearance::LoadOptions load;
  std::vector<std::string> skipped;
  const auto images = face::appearance::load_training_images(set, "", load, *context.progress,
                                                             context.stop, skipped);
  for (const std::string& one : skipped) log_warning("{}; left out", one);
  face::appearance::ConvergenceOptions options;
  options.tries = flags.tries;
  options.limit = flags.limit / 100;
  options.eyes = outer_eyes_of(flags.eyes, set.points());
  options.seed = context.seed;
  std::vector<face::appearance::ConvergenceCurve> curves;
  for (const auto& [name, method] :
       {std::pair{"project-out", face::appearance::Method::kProjectOut},
        std::pair{"alternating", face::appearance::Method::kAlternating}}) {
    face::appearance::FitOptions fit = tracker.fitter().options();
    fit.method = method;
    const face::appearance::Fitter fitter(tracker.model(), fit);
    curves.push_back({name, face::appearance::study_convergence(fitter, images, options,
                                                                *context.progress, context.stop)});
    for (const face::appearance::ConvergencePoint& point : curves.back().points) {
      const double share = point.tries > 0 ? static_cast<double>(point.converged) / point.tries : 0;
      if (context.json) {
        print_json(nlohmann::ordered_json{{"method", name},
                                          {"disturbance", point.disturbance},
                                          {"tries", point.tries},
                                          {"converged", rounded(share, 4)},
                                          {"error", rounded(100 * point.mean_error, 4)}});
      } else {
        print_text(fmt::format("{:<12} disturbance {:.2f}: {:5.1f} % converge, to {:.2f} %\n", name,
                               point.disturbance, 100 * share, 100 * point.mean_error));
      }
    }
  }
  write_image(flags.convergence, face::appearance::draw_convergence(curves, options));
  return ExitStatus::kDone;
}

ExitStatus run_aam_eval(AamEvalFlags& flags, Context& context) {
  const face::shape::LandmarkSet set =
      face::shape::complete_samples(part_of(load_set(flags.set), flags.held_out, Part::kHeldOut));
  if (set.samples.empty())
    throw InputError(flags.set.input, "no complete sample is left to evaluate");
  const face::AppearanceTracker tracker = load_appearance_tracker(flags.aam);
  if (tracker.model().points() != set.points())
    throw InputError(flags.set.input, fmt::format("has {} points, the model {}", set.points(),
                                                  tracker.model().points()));
  const std::array<int, 2> eyes = outer_eyes_of(flags.eyes, set.points());
  if (!flags.convergence.empty()) return convergence(flags, set, tracker, context);

  std::vector<face::landmarks::FitOutcome> outcomes;
  std::string lines;
  std::string table = "image,nme,missed,wrong,dx,dy,error,lost,iterations,ms\n";
  const face::appearance::FindStarts find = tracker.find_starts();
  face::appearance::FitWorkspace workspace;
  double total_ms = 0;
  int iterations = 0;
  int within_limit = 0;
  context.progress->begin("fitting", static_cast<std::int64_t>(set.samples.size()), "images");
  for (const face::shape::LandmarkSample& sample : set.samples) {
    throw_if_stopped(context.stop);
    context.progress->advance();
    if (!face::landmarks::has_eye_distance(sample.points, eyes)) {
      log_warning("{}: its two eyes lie in one place; left out", sample.image);
      continue;
    }
    cv::Mat image;
    try {
      image = read_image(sample.image);
    } catch (const InputError& error) {
      log_warning("{}; left out", error.what());
      continue;
    }
    const Stopwatch watch;
    const std::vector<face::appearance::TrackedObject> objects =
        face::appearance::find_objects(tracker.fitter(), find, image, 4, workspace);
    const double ms = watch.ms();
    total_ms += ms;
    const face::appearance::TrackedObject* object = nearest_object(objects, sample.points);
    std::optional<Eigen::Matrix2Xd> points;
    if (object != nullptr) points = object->fit.points;
    face::landmarks::FitOutcome outcome =
        face::landmarks::evaluate_fit(points, sample.points, eyes);
    outcome.image = sample.image;
    outcome.ms = ms;
    if (object != nullptr) iterations += object->fit.iterations;
    within_limit += !outcome.missed && !outcome.wrong && outcome.nme <= flags.limit ? 1 : 0;
    lines += line_of(sample.image, points, ms);
    table += fmt::format("{},{:.4f},{:d},{:d},{:.4f},{:.4f},{:.4f},{:d},{},{:.2f}\n",
                         csv_field(sample.image), outcome.nme, outcome.missed, outcome.wrong,
                         outcome.dx, outcome.dy, object != nullptr ? object->fit.error : 1,
                         object != nullptr && object->fit.lost,
                         object != nullptr ? object->fit.iterations : 0, ms);
    outcomes.push_back(std::move(outcome));
  }
  context.progress->end();
  if (!flags.output.empty()) write_file_atomically(flags.output, lines);
  if (!flags.csv.empty()) write_file_atomically(flags.csv, table);
  const face::landmarks::LandmarkScore score = face::landmarks::score_of(outcomes);
  const int fitted = std::max(1, score.faces - score.missed);
  const double share = static_cast<double>(within_limit) / std::max(1, score.faces);
  if (context.json) {
    nlohmann::ordered_json line = {
        {"faces", score.faces},
        {"missed", score.missed},
        {"wrong", score.wrong},
        {"nme_mean", rounded(score.mean, 4)},
        {"nme_median", rounded(score.median, 4)},
        {"limit", flags.limit},
        {"within", rounded(share, 4)},
        {"failures", rounded(score.failures, 4)},
        {"auc_8", rounded(score.auc, 4)},
        {"bias_x", rounded(score.dx, 4)},
        {"bias_y", rounded(score.dy, 4)},
        {"iterations", rounded(static_cast<double>(iterations) / fitted, 4)},
        {"ms", rounded(total_ms / std::max(1, score.faces), 4)}};
    print_json(line);
  } else {
    print_text(fmt::format(
        "{} faces, {} not found, {} another face; NME mean {:.2f} %, median {:.2f} %; within {:g} "
        "%: {:.1f} %; above 8 % or not found {:.1f} %; bias x {:+.2f} %, y {:+.2f} %; {:.1f} "
        "iterations, {:.1f} ms\n",
        score.faces, score.missed, score.wrong, score.mean, score.median, flags.limit, 100 * share,
        100 * score.failures, score.dx, score.dy, static_cast<double>(iterations) / fitted,
        total_ms / std::max(1, score.faces)));
  }
  return score.missed == score.faces ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

void add_flags(Command& verb, AamEvalFlags& flags) {
  add_set_flags(verb, flags.set);
  add_aam_flags(verb, flags.aam);
  verb.add_option("--held-out", flags.held_out,
                  "only every N-th sample (held out by `train --hold-out N`); 0: all")
      .check(range(0, 1000000))
      .show_default();
  verb.add_option("--limit", flags.limit, "maximum error of a good fit, % of the eye distance")
      .check(range(0.01, 100.0))
      .show_default();
  verb.add_option("-o,--output", flags.output, "output file of the fitted landmarks, JSON lines");
  verb.add_option("--csv", flags.csv, "CSV file, one row an image");
  verb.add_option("--convergence", flags.convergence,
                  "study: convergence of fits from random initial positions; output image");
  verb.add_option("--tries", flags.tries,
                  "number of tries for each image and disturbance of the study")
      .check(range(1, 1000))
      .show_default();
  verb.add_option(
          "--eyes", flags.eyes,
          "two landmarks whose distance normalises the errors [outer eye corners of known markups]")
      .delimiter(',')
      .expected(2);
}

}  // namespace

void add_aam_eval(Command& area, Context& context) {
  add_verb<AamEvalFlags>(area, "eval", "evaluate fits on annotated images", context, add_flags,
                         run_aam_eval);
}

}  // namespace tarsier::cli
