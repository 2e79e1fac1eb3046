// SPDX-License-Identifier: MIT
#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/detection.h"
#include "tarsier/face/landmarks/evaluation.h"
#include "tarsier/face/landmarks/faces_json.h"
#include "tarsier/face/landmarks/person_study.h"
#include "tarsier/face/regression/occlusion.h"
#include "tarsier/face/regression/visibility.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "framework/stopwatch.h"
#include "verbs/landmarks/engine.h"
#include "verbs/landmarks/landmarks.h"
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct LandmarkEvalFlags {
  SetFlags set;
  LandmarkFlags landmarks;
  int held_out = 0;
  std::string results;
  std::string output;
  std::string csv;
  std::vector<int> eyes;
  bool by_person = false;
  bool detection = false;
  bool worst = false;
  bool occlude = false;
};

nlohmann::ordered_json json_of(const face::landmarks::LandmarkScore& score) {
  return {{"faces", score.faces},
          {"missed", score.missed},
          {"wrong", score.wrong},
          {"nme_mean", rounded(score.mean, 4)},
          {"nme_median", rounded(score.median, 4)},
          {"nme_p90", rounded(score.p90, 4)},
          {"failures", rounded(score.failures, 4)},
          {"auc_8", rounded(score.auc, 4)},
          {"bias_x", rounded(score.dx, 4)},
          {"bias_y", rounded(score.dy, 4)}};
}

std::string text_of(const face::landmarks::LandmarkScore& score) {
  return fmt::format(
      "{} faces, {} not found, {} another face; NME mean {:.2f} %, median {:.2f} %, p90 {:.2f} %; "
      "above 8 % or not found {:.1f} %; AUC up to 8 % {:.3f}; bias x {:+.2f} %, y {:+.2f} %\n",
      score.faces, score.missed, score.wrong, score.mean, score.median, score.p90,
      100 * score.failures, score.auc, score.dx, score.dy);
}

nlohmann::ordered_json json_of(const face::regression::VisibilityScore& visibility) {
  return {{"hidden", visibility.hidden},
          {"hidden_found", visibility.hidden_flagged},
          {"seen", visibility.visible},
          {"seen_flagged", visibility.visible_flagged},
          {"within_sigma", rounded(visibility.coverage(), 4)}};
}

std::string text_of(const face::regression::VisibilityScore& visibility) {
  std::string hidden;
  if (visibility.hidden > 0)
    hidden =
        fmt::format("{:.1f} % of {} hidden points flagged, {:.1f} % of the flagged are hidden; ",
                    100 * visibility.recall(), visibility.hidden, 100 * visibility.precision());
  return fmt::format("{}{:.1f} % of {} points within sigma_px\n", hidden,
                     100 * visibility.coverage(), visibility.hidden + visibility.visible);
}

ExitStatus study_persons(const LandmarkEvalFlags& flags, const face::shape::LandmarkSet& set,
                         Context& context) {
  const face::landmarks::PersonStudy study = face::landmarks::study_persons(
      set, outer_eyes_of(flags.eyes, set.points()), context.seed, *context.progress, context.stop);
  for (const face::landmarks::PersonStudy::Row& row : study.rows) {
    if (context.json) {
      nlohmann::ordered_json line = {{"person", row.person},
                                     {"trained", row.trained},
                                     {"tested", row.tested},
                                     {"generic", row.generic},
                                     {"specific", row.specific}};
      print_json(line);
    } else {
      print_text(
          fmt::format("{}: generic {:.2f} %, person-specific {:.2f} % ({} images train, {} "
                      "test)\n",
                      row.person, row.generic, row.specific, row.trained, row.tested));
    }
  }
  const double gain = 1 - study.specific / study.generic;
  if (context.json) {
    nlohmann::ordered_json line = {
        {"generic", study.generic}, {"specific", study.specific}, {"gain", rounded(gain, 4)}};
    print_json(line);
  } else {
    print_text(fmt::format("generic {:.2f} %, person-specific {:.2f} %: {:.0f} % less error\n",
                           study.generic, study.specific, 100 * gain));
  }
  return ExitStatus::kDone;
}

// Evaluates boxes only.
ExitStatus evaluate_detection(const LandmarkEvalFlags& flags, Context& context) {
  const std::vector<face::shape::BoxedImage> images =
      load_boxes(flags.set, flags.held_out, Part::kHeldOut);
  const face::LandmarkTracker tracker = load_landmark_tracker(flags.landmarks);
  face::landmarks::FaceFinder finder = tracker.detector().make_finder();
  face::landmarks::DetectionEvaluator evaluator;
  context.progress->begin("detecting", static_cast<std::int64_t>(images.size()), "images");
  for (const face::shape::BoxedImage& image : images) {
    throw_if_stopped(context.stop);
    context.progress->advance();
    try {
      const cv::Mat gray = read_gray_image(image.image);
      const Stopwatch watch;
      const std::vector<face::landmarks::Candidate> found = finder.find_confident(gray);
      const double ms = watch.ms();
      evaluator.add(tracker.model(), finder, found, image, ms);
    } catch (const InputError& error) {
      log_warning("{}; left out", error.what());
    }
  }
  context.progress->end();
  const face::landmarks::DetectionScore score = evaluator.score();
  const double rate = static_cast<double>(score.found) / std::max(1, score.objects);
  if (context.json) {
    const nlohmann::ordered_json line = {{"images", score.images},
                                         {"objects", score.objects},
                                         {"found", score.found},
                                         {"rate", rounded(rate, 4)},
                                         {"false_alarms", score.false_alarms},
                                         {"off", rounded(score.center_error, 4)},
                                         {"ms", rounded(score.ms, 2)}};
    print_json(line);
  } else {
    print_text(fmt::format(
        "{} of {} found ({:.1f} %), mean error {:.1f} % of the box; {} false alarms in {} images\n",
        score.found, score.objects, 100 * rate, 100 * score.center_error, score.false_alarms,
        score.images));
  }
  return score.found == 0 ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

ExitStatus run_landmark_eval(LandmarkEvalFlags& flags, Context& context) {
  if (flags.occlude && (flags.detection || flags.by_person || !flags.results.empty()))
    throw UsageError(
        "--occlude evaluates a model on images: not with --detection, --by-person, --results");
  if (flags.detection) return evaluate_detection(flags, context);
  const face::shape::LandmarkSet set =
      face::shape::complete_samples(part_of(load_set(flags.set), flags.held_out, Part::kHeldOut));
  if (set.samples.empty())
    throw InputError(flags.set.input, "no complete sample is left to evaluate");
  if (flags.by_person) return study_persons(flags, set, context);
  const std::array<int, 2> eyes = outer_eyes_of(flags.eyes, set.points());

  std::optional<face::LandmarkTracker> tracker;
  face::LandmarkState state;
  face::landmarks::FaceLines given;
  if (flags.results.empty()) {
    tracker.emplace(load_landmark_tracker(flags.landmarks));
    if (tracker->model().points() != set.points()) {
      throw InputError(flags.set.input, fmt::format("has {} points, the model {}", set.points(),
                                                    tracker->model().points()));
    }
  } else {
    given = face::landmarks::read_face_lines(flags.results);
  }
  std::vector<face::landmarks::FitOutcome> outcomes;
  std::string lines;
  double total_ms = 0;
  face::regression::VisibilityScore visibility;
  const Rng root(context.seed);
  context.progress->begin("fitting", static_cast<std::int64_t>(set.samples.size()), "faces");
  for (const face::shape::LandmarkSample& sample : set.samples) {
    throw_if_stopped(context.stop);
    context.progress->advance();
    if (!face::landmarks::has_eye_distance(sample.points, eyes)) {
      log_warning("{}: its two eyes lie in one place; left out", sample.image);
      continue;
    }
    const auto index = static_cast<std::size_t>(&sample - set.samples.data());
    std::vector<bool> hidden(static_cast<std::size_t>(set.points()), false);
    std::optional<face::regression::Visibility> seen_visibility;
    std::optional<Eigen::Matrix2Xd> points;
    double ms = 0;
    if (tracker) {
      Frame frame;
      frame.still = true;
      try {
        frame.image = read_gray_image(sample.image);
        if (flags.occlude) {
          const std::size_t other = (index + set.samples.size() / 2) % set.samples.size();
          Rng rng = root.fork(index);
          hidden = face::regression::draw_occlusion(frame.image, sample.points,
                                                    read_gray_image(set.samples[other].image), rng);
        }
      } catch (const InputError& error) {
        log_warning("{}; left out", error.what());
        continue;
      }
      const face::LandmarkResult result = tracker->process(frame, state);
      ms = result.ms;
      total_ms += ms;
      if (!result.faces.empty()) {
        points = result.faces.front().points;
        if (tracker->model().visibility) seen_visibility = result.faces.front().visibility;
      }
      nlohmann::ordered_json line{{"image", sample.image}};
      line.update(to_json(result));
      lines += json_text(line) + "\n";
    } else {
      points = given.find(sample.image, set.points());
    }
    face::landmarks::FitOutcome outcome =
        face::landmarks::evaluate_fit(points, sample.points, eyes);
    outcome.image = sample.image;
    outcome.person = sample.person;
    outcome.ms = ms;
    if (seen_visibility && !outcome.wrong)
      visibility.add(*seen_visibility, *points, sample.points, hidden);
    outcomes.push_back(std::move(outcome));
  }
  context.progress->end();
  if (!flags.output.empty()) write_file_atomically(flags.output, lines);
  if (!flags.csv.empty()) {
    std::string table = "image,nme,missed,wrong,dx,dy,ms\n";
    for (const face::landmarks::FitOutcome& o : outcomes) {
      table += fmt::format("{},{:.4f},{:d},{:d},{:.4f},{:.4f},{:.2f}\n", csv_field(o.image), o.nme,
                           o.missed, o.wrong, o.dx, o.dy, o.ms);
    }
    write_file_atomically(flags.csv, table);
  }
  const face::landmarks::LandmarkScore score = face::landmarks::score_of(outcomes);
  if (context.json) {
    nlohmann::ordered_json line = json_of(score);
    if (visibility.hidden + visibility.visible > 0) line["visibility"] = json_of(visibility);
    if (tracker) line["ms"] = rounded(total_ms / std::max(1, score.faces), 2);
    print_json(line);
  } else {
    print_text(text_of(score));
    if (visibility.hidden + visibility.visible > 0) print_text(text_of(visibility));
  }
  return score.missed == score.faces ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

void add_flags(Command& verb, LandmarkEvalFlags& flags) {
  add_set_flags(verb, flags.set);
  add_landmark_flags(verb, flags.landmarks);
  verb.add_option("--held-out", flags.held_out,
                  "only every N-th sample (held out by `train --hold-out N`); 0: all")
      .check(range(0, 1000000))
      .show_default();
  verb.add_option("--results", flags.results,
                  "evaluate these JSON lines {\"image\",\"points\"} or {\"image\",\"faces\"} "
                  "instead of a model");
  verb.add_option("-o,--output", flags.output, "output file of the fitted landmarks, JSON lines");
  verb.add_option("--csv", flags.csv, "CSV file, one row an image");
  verb.add_option(
          "--eyes", flags.eyes,
          "two landmarks whose distance normalises the errors [outer eye corners of known markups]")
      .delimiter(',')
      .expected(2);
  verb.add_flag(
      "--by-person", flags.by_person,
      "study: compare descent trained on other people and on half of the person's own images");
  verb.add_flag(
      "--occlude", flags.occlude,
      "occlude each face by a drawn object (by --seed) and evaluate the predicted visibility");
  verb.add_flag("--detection", flags.detection,
                "evaluate face detection instead of landmarks; SET may be a dlib .xml of boxes");
}

}  // namespace

void add_landmarks_eval(Command& area, Context& context) {
  add_verb<LandmarkEvalFlags>(area, "eval", "evaluate accuracy on annotated images", context,
                              add_flags, run_landmark_eval);
}

}  // namespace tarsier::cli
