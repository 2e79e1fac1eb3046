// SPDX-License-Identifier: MIT
#include "tarsier/face/head/train_head.h"

#include "tarsier/core/errors.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/stopwatch.h"
#include "verbs/landmarks/landmarks.h"
#include "verbs/pose/pose.h"
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct TrainHeadFlags {
  SetFlags set;
  std::string output;
  std::string terms;
  std::string compare;
  std::vector<int> eyes;
  face::head::TrainHeadOptions options;
};

face::shape::Markup markup_of(const TrainHeadFlags& flags, const face::shape::LandmarkSet& set) {
  face::shape::Markup markup;
  if (const auto known = face::shape::known_markup(set.points())) markup = *known;
  if (!set.mirror.empty()) markup.mirror = set.mirror;
  if (!set.connections.empty()) markup.connections = set.connections;
  if (!flags.eyes.empty()) {
    for (const int eye : flags.eyes) {
      if (eye < 0 || eye >= set.points()) {
        throw UsageError(fmt::format("--eyes {}: the set has points 0..{}", eye, set.points() - 1));
      }
    }
    markup.outer_eyes = {flags.eyes[0], flags.eyes[1]};
  }
  if (markup.mirror.empty()) {
    throw InputError(flags.set.input,
                     "does not say which points are left and right of each other: mark the "
                     "symmetry with `landmarks annotate`");
  }
  if (markup.outer_eyes[0] < 0) {
    throw UsageError(fmt::format(
        "--eyes A,B: unknown markup of {} points; give the two outer eye corners", set.points()));
  }
  return markup;
}

nlohmann::json provenance(const TrainHeadFlags& flags, const Context& context, int faces,
                          double rms) {
  const face::head::TrainHeadOptions& o = flags.options;
  const std::filesystem::path input = std::filesystem::path(flags.set.input).lexically_normal();
  return {{"program", fmt::format("tarsier {}", version())},
          {"seed", context.seed},
          {"data", input.parent_path().filename().string() + "/" + input.filename().string()},
          {"faces", faces},
          {"measured", {{"rms_mm", rounded(rms, 2)}}},
          {"options",
           {{"modes", o.modes},
            {"iterations", o.iterations},
            {"outer_eye_mm", o.outer_eye_mm},
            {"distance_mm", o.distance_mm},
            {"outline_yaw_deg", o.outline_yaw_deg},
            {"robust_sigmas", o.robust_sigmas}}},
          {"terms", flags.terms}};
}

ExitStatus run_train_head(TrainHeadFlags& flags, Context& context) {
  const Stopwatch watch;
  flags.options.seed = context.seed;
  flags.options.check();
  const face::shape::LandmarkSet set = load_set(flags.set);
  const face::shape::Markup markup = markup_of(flags, set);
  std::vector<Eigen::Matrix2Xd> faces;
  for (const face::shape::LandmarkSample& sample : set.samples) faces.push_back(sample.points);
  face::head::TrainedHead trained;
  try {
    trained =
        face::head::train_head(faces, markup, flags.options, context.progress.get(), context.stop);
  } catch (const std::invalid_argument& error) {
    // Too few faces, or faces without rotation.
    throw InputError(flags.set.input, error.what());
  }
  face::head::write_head_model(
      flags.output, trained.model,
      provenance(flags, context, trained.model.trained_on, trained.rms_mm));
  const auto turned =
      std::count_if(trained.angles.begin(), trained.angles.end(),
                    [](const face::head::HeadAngles& a) { return std::abs(a.yaw_deg) > 25; });
  nlohmann::ordered_json line;
  line["output"] = flags.output;
  line["faces"] = trained.model.trained_on;
  line["turned_beyond_25"] = turned;
  line["modes"] = trained.model.mode_count();
  line["rms_mm"] = rounded(trained.rms_mm, 3);
  if (!flags.compare.empty()) {
    const face::head::HeadComparison comparison =
        face::head::compare_head(trained.model, flags.compare);
    line["compared_mm"] = rounded(comparison.all_mm, 3);
    if (comparison.inner_mm > 0) {
      line["compared_inner51_mm"] = rounded(comparison.inner_mm, 3);
    }
  }
  line["seconds"] = rounded(watch.seconds(), 1);
  if (context.json) {
    print_json(line);
    return ExitStatus::kDone;
  }
  print_text(
      fmt::format("{}: {} faces ({} turned by more than 25 degrees), {} modes, rms {:.2f} "
                  "mm, {} s\n",
                  flags.output, trained.model.trained_on, turned, trained.model.mode_count(),
                  trained.rms_mm, line["seconds"].get<double>()));
  if (line.contains("compared_mm")) {
    print_text(fmt::format("{}: {:.2f} mm mean over all points", flags.compare,
                           line["compared_mm"].get<double>()));
    if (line.contains("compared_inner51_mm")) {
      print_text(
          fmt::format(", {:.2f} mm over the inner 51", line["compared_inner51_mm"].get<double>()));
    }
    print_text("\n");
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, TrainHeadFlags& flags) {
  add_set_flags(verb, flags.set);
  verb.add_option("-o,--output", flags.output, "output model file (.json)").required();
  verb.add_option("--terms", flags.terms, "terms of use of the data, stored in the model");
  face::head::TrainHeadOptions& options = flags.options;
  bind_all(verb, options);
  verb.add_option("--outline", options.outline,
                  "landmarks on the face outline, which slide [0..16 of 68]")
      .delimiter(',');
  verb.add_option("--eyes", flags.eyes,
                  "landmarks of the outer eye corners, left and right [known markups]")
      .delimiter(',')
      .expected(2);
  verb.add_option("--compare", flags.compare, "file of 3D landmarks to compare the mean head with");
}

}  // namespace

void add_pose_train_head(Command& area, Context& context) {
  add_verb<TrainHeadFlags>(area, "train-head",
                           "train the 3D head model on facial landmarks in images", context,
                           add_flags, run_train_head);
}

}  // namespace tarsier::cli
