// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/head_view/view_train.h"
#include "tarsier/face/pipelines/view_training.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "verbs/landmarks/landmarks.h"
#include "verbs/pose/pose.h"
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct TrainViewFlags {
  PoseFlags pose;
  std::string pointing;
  std::vector<std::string> truths;
  SetFlags annotated;
  std::string output;
  std::string terms;
  double tilt_share = 0.9;
  bool leave_out = false;
  face::head_view::TrainViewOptions options;
};

void print_scores(const face::ViewTraining::Scores& scores, const Context& context,
                  const std::string& what) {
  if (scores.pointing) print_pointing(*scores.pointing, context, what);
  if (!scores.exact) return;
  const face::head::PoseScore& score = *scores.exact;
  if (context.json) {
    nlohmann::ordered_json line{{"set", "truth"},
                                {"what", what},
                                {"images", score.truths},
                                {"pitch_mae", score.pitch_mae_deg},
                                {"yaw_mae", score.yaw_mae_deg},
                                {"roll_mae", score.roll_mae_deg},
                                {"rotation_mean", score.mean_deg}};
    add_coverage(score.coverage, line);
    add_coverage(score.image_coverage, line, "_image");
    print_json(line);
  } else {
    print_text(fmt::format(
        "{}: {} images of exact truth: MAE pitch {:.2f} yaw {:.2f} roll {:.2f}, rotation mean "
        "{:.2f} degrees\n",
        what, score.truths, score.pitch_mae_deg, score.yaw_mae_deg, score.roll_mae_deg,
        score.mean_deg));
    print_text(coverage_text(score.coverage));
    print_text(coverage_text(score.image_coverage, " of the image (without the floor)"));
  }
}

nlohmann::json provenance(const TrainViewFlags& flags, const face::ViewTraining& training) {
  const face::head_view::TrainViewOptions& o = flags.options;
  nlohmann::json result{{"program", fmt::format("tarsier {}", version())},
                        {"data", training.sources()},
                        {"views", training.samples().size()},
                        {"options",
                         {{"components", o.components},
                          {"offset_weight", o.offset_weight},
                          {"angle_weight", o.angle_weight},
                          {"gamma", o.gamma},
                          {"ridge", o.ridge},
                          {"exact_ridge", o.exact_ridge},
                          {"group_error", o.group_error},
                          {"mirror", o.mirror},
                          {"tilt_share", flags.tilt_share}}}};
  if (!flags.terms.empty()) result["terms"] = flags.terms;
  return result;
}

ExitStatus run_train_view(TrainViewFlags& flags, Context& context) {
  if (flags.pointing.empty() && flags.truths.empty() && flags.annotated.input.empty())
    throw UsageError("give --pointing DIR, --truth FILE or --annotated SET");
  if (flags.output.empty() && !flags.leave_out) throw UsageError("give -o FILE or --leave-out");
  flags.options.check();
  flags.pose.refine = "none";
  const face::PoseTrackerOptions options = pose_options(flags.pose);
  face::ViewTraining training(load_pose_models(options), options);
  Progress& progress = *context.progress;
  if (!flags.pointing.empty())
    training.add_pointing(flags.pointing, flags.tilt_share, progress, context.stop);
  for (const std::string& truth : flags.truths) training.add_truth(truth, progress, context.stop);
  if (!flags.annotated.input.empty()) {
    const face::shape::LandmarkSet set = face::shape::complete_samples(load_set(flags.annotated));
    training.add_annotated(set, flags.annotated.input, progress, context.stop);
  }
  std::string input = flags.pointing;
  if (input.empty()) input = flags.truths.empty() ? flags.annotated.input : flags.truths.front();
  try {
    if (flags.leave_out) {
      print_scores(training.score_landmarks(), context, "landmarks alone");
      print_scores(training.score_held_out(flags.options), context,
                   "refined, each person left out in turn");
    }
    if (flags.output.empty()) return ExitStatus::kDone;
    const face::head_view::ViewModel model =
        face::head_view::train_view_model(training.samples(), flags.options);
    face::head_view::write_view_model(flags.output, model, provenance(flags, training));
  } catch (const std::invalid_argument& error) {
    throw InputError(input, error.what());  // too few heads, or all alike
  }
  if (context.json) {
    print_json(
        nlohmann::ordered_json{{"output", flags.output}, {"views", training.samples().size()}});
  } else {
    print_text(fmt::format("{}: {} views\n", flags.output, training.samples().size()));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, TrainViewFlags& flags) {
  add_landmark_flags(verb, flags.pose.landmarks);
  verb.add_option("--head", flags.pose.head, "head model [head.json, shipped]");
  verb.add_option("--mapping", flags.pose.mapping,
                  "landmark of each head point: lines \"head_point landmark\", from 0");
  verb.add_option("--focal", flags.pose.focal, "focal length, px [1.3 times the longer image side]")
      .check(above(0));
  verb.add_option("--pointing", flags.pointing,
                  "folder of the Pointing'04 head pose set; file names contain the angles");
  verb.add_option("--tilt-share", flags.tilt_share,
                  "ratio of the true tilt to the tilt in Pointing'04's file names")
      .check(range(0.1, 1.5))
      .show_default();
  verb.add_option("--truth", flags.truths,
                  "ground truth: JSON lines {\"image\", \"rotation\": [9 numbers]}, as of `pose "
                  "synth`; repeatable");
  verb.add_option(
      "--annotated", flags.annotated.input,
      "annotated faces, as for `pose train-head`; the pose of their landmarks is the ground truth");
  verb.add_option("-o,--output", flags.output, "output model file (.json)");
  verb.add_option("--terms", flags.terms, "terms of use of the data, stored in the model");
  verb.add_flag("--leave-out", flags.leave_out,
                "print the error on held-out people, each in turn (--truth, --annotated: on a "
                "seventh of the images)");
  face::head_view::TrainViewOptions& options = flags.options;
  bind_all(verb, options);
}

}  // namespace

void add_pose_train_view(Command& area, Context& context) {
  add_verb<TrainViewFlags>(
      area, "train-view",
      "train the appearance-based pose correction (--view) on images with known poses", context,
      add_flags, run_train_view);
}

}  // namespace tarsier::cli
