// SPDX-License-Identifier: MIT

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/train_model.h"
#include "tarsier/face/regression/mirror_shift.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/face/regression/regression_network.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/regression/visibility.h"
#include "tarsier/face/train/face_turn.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include "framework/bind.h"
#include "framework/stopwatch.h"
#include "verbs/landmarks/landmarks.h"
#include "verbs/pose/engine.h"
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::cli {
namespace {

// The flags of all verbs that train on a set.
struct LearnFlags : TrainingFlags {
  bool mirror = false;
};

struct LandmarkTrainFlags : LearnFlags {
  std::string method = "ridge";
  std::string without;
  std::string head;
  face::train::CopyOptions turned{.copies = 0};
  face::landmarks::TrainModelOptions options;
};

void add_learn_flags(Command& verb, LearnFlags& flags) {
  add_training_flags(verb, flags);
  verb.add_flag("--mirror", flags.mirror, "add mirrored images to the training set");
}

// The training samples.
face::shape::LandmarkSet set_of(const LearnFlags& flags) {
  face::shape::LandmarkSet set = part_of(load_set(flags.set), flags.hold_out, Part::kOthers);
  if (flags.mirror && set.mirror.empty()) {
    throw UsageError(
        "--mirror: the set does not say which points are left and right of each "
        "other; mark the symmetry with `landmarks annotate`");
  }
  return set;
}

// Prints `line` with the training time added.
void print_learnt(const LearnFlags& flags, std::size_t samples, const Stopwatch& watch,
                  nlohmann::ordered_json line, const Context& context) {
  line["seconds"] = rounded(watch.seconds(), 1);
  if (context.json) {
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format("{}: {} samples, {} s\n", flags.output, samples,
                           line["seconds"].get<double>()));
  }
}

// Adds `turned` rotated copies of each face, with the given or the shipped head model.
void add_turned_faces(const LandmarkTrainFlags& flags, const face::shape::LandmarkSet& set,
                      face::landmarks::TrainModelOptions& options) {
  const auto turner = std::make_shared<const face::train::FaceTurner>(read_head(flags.head));
  if (turner->points() != set.points()) {
    throw UsageError(
        fmt::format("--turned: the head has {} points, the set {}; --head takes one "
                    "that `pose train-head` learnt from such a set",
                    turner->points(), set.points()));
  }
  options.extra = [turner, copies = flags.turned](const face::regression::TrainingFace& face,
                                                  std::uint64_t seed) {
    return face::train::turned_copies(*turner, face, copies, seed);
  };
  options.start_shapes = [turner](const face::regression::TrainingFace& face, int count,
                                  std::uint64_t seed) {
    return turner->shapes_near(face.points, count, seed);
  };
}

enum class Kind { kShape, kPatches, kDetector, kTrees, kTracker };

nlohmann::json provenance(const LandmarkTrainFlags& flags, const Context& context,
                          std::size_t samples) {
  nlohmann::json about = {
      {"program", fmt::format("tarsier {}", version())},
      {"seed", context.seed},
      {"data",
       std::filesystem::path(flags.set.input).lexically_normal().parent_path().filename().string() +
           "/" + std::filesystem::path(flags.set.input).filename().string()},
      {"samples", samples},
      {"mirrored", flags.mirror},
      {"terms", flags.terms}};
  if (flags.turned.copies > 0) about["turned"] = flags.turned.copies;
  if (flags.hold_out > 0) about["left_out"] = fmt::format("every {}th", flags.hold_out);
  return about;
}

ExitStatus train_landmarks(LandmarkTrainFlags& flags, Context& context, Kind kind) {
  const Stopwatch watch;
  const face::shape::LandmarkSet set = set_of(flags);
  const nlohmann::json about = provenance(flags, context, set.samples.size());
  nlohmann::ordered_json line;
  line["output"] = flags.output;
  line["samples"] = set.samples.size();
  if (kind == Kind::kShape) {
    flags.options.shape.mirror = flags.mirror;
    face::shape::ShapeModel model;
    try {
      const EndOnSignals at_once;  // nothing is written yet
      model = face::shape::train_shape_model(set, flags.options.shape);
    } catch (const std::invalid_argument& error) {
      throw InputError(flags.set.input, error.what());
    }
    face::shape::write_shape_model(flags.output, model, about);
    line["modes"] = model.mode_count();
    line["variance"] = model.variance_kept;
  } else {
    face::landmarks::TrainModelOptions& options = flags.options;
    options.mirror = flags.mirror;
    options.seed = context.seed;
    if (flags.turned.copies > 0) add_turned_faces(flags, set, options);
    options.trees = kind == Kind::kTrees || (kind == Kind::kTracker && flags.without != "trees");
    options.descent = kind == Kind::kTracker && flags.without != "sdm";
    options.patches =
        kind == Kind::kPatches || (kind == Kind::kTracker && flags.without != "patch");
    options.quality = kind == Kind::kTracker;
    if (flags.method == "sgd") {
      options.patch_options.method = face::regression::PatchMethod::kStochastic;
    } else if (flags.method == "average") {
      options.patch_options.method = face::regression::PatchMethod::kAverage;
    } else if (flags.method != "ridge") {
      throw UsageError(
          fmt::format("--patch-method {}: expected ridge, sgd or average", flags.method));
    }
    const face::landmarks::TrainedModel trained =
        face::landmarks::train_landmark_model(set, "", options, *context.progress, context.stop);
    for (const std::string& skipped : trained.skipped) log_warning("{}; left out", skipped);
    if (kind == Kind::kDetector && trained.model.box.trained_on == 0) {
      throw InputError(flags.set.input, "the face detector detects none of the objects");
    }
    face::landmarks::write_landmark_model(flags.output, trained.model, about);
    line["faces"] = trained.faces;
    if (trained.extra > 0) line["turned"] = trained.extra;
    line["detected"] = trained.detected;
    line["modes"] = trained.model.shape.mode_count();
    line["to_the_right_px"] = trained.to_the_right;
  }
  print_learnt(flags, set.samples.size(), watch, std::move(line), context);
  return ExitStatus::kDone;
}

void add_kind(Command& parent, Context& context, const char* name, const char* help, Kind kind) {
  const auto add_flags = [kind](Command& verb, LandmarkTrainFlags& flags) {
    add_learn_flags(verb, flags);
    face::landmarks::TrainModelOptions& options = flags.options;
    bind_all(verb, options.shape);
    if (kind == Kind::kTrees || kind == Kind::kTracker) {
      bind_all(verb, options.tree_options);
      bind_field(verb, options, options.starts);
    }
    if (kind == Kind::kPatches || kind == Kind::kTracker) {
      verb.add_option("--patch-method", flags.method,
                      "ridge (closed form), sgd (stochastic gradient descent) or average")
          .show_default();
      bind_field(verb, options.patch_options, options.patch_options.patch);
    }
    if (kind == Kind::kTracker) {
      bind_field(verb, flags.turned, flags.turned.copies);
      verb.add_option("--head", flags.head, "3D head model for the rotated copies (.json)");
      verb.add_option("--without", flags.without, "omit a part: trees, sdm or patch")
          .check(one_of({"trees", "sdm", "patch"}));
    }
  };
  const auto run = [kind](LandmarkTrainFlags& flags, Context& the_context) {
    return train_landmarks(flags, the_context, kind);
  };
  add_verb<LandmarkTrainFlags>(parent, name, help, context, add_flags, run);
}

// The flags of verbs that add a part to a tracker.
template <typename Options>
struct PartFlags : LearnFlags {
  std::string model;
  Options options;
};

// Reads the tracker, calls `learn(set, model, skipped)` to add the part, and writes the tracker
// with the provenance of the part `name`. Throws InputError if tracker and set have different
// points.
template <typename Options, typename Learn>
ExitStatus train_part(PartFlags<Options>& flags, Context& context, const char* name,
                      const Learn& learn) {
  const Stopwatch watch;
  const face::shape::LandmarkSet set = set_of(flags);
  face::landmarks::LandmarkModel model = face::landmarks::read_landmark_model(flags.model);
  if (model.points() != set.points())
    throw InputError(flags.set.input,
                     fmt::format("has {} points, the model {}", set.points(), model.points()));
  nlohmann::json about = face::landmarks::landmark_model_provenance(flags.model);
  about[name] = {{"program", fmt::format("tarsier {}", version())},
                 {"seed", context.seed},
                 {"samples", set.samples.size()},
                 {"steps", flags.options.steps},
                 {"terms", flags.terms}};
  flags.options.seed = context.seed;
  std::vector<std::string> skipped;
  learn(set, model, skipped);
  for (const std::string& one : skipped) log_warning("{}; left out", one);
  face::landmarks::write_landmark_model(flags.output, model, about);
  print_learnt(flags, set.samples.size(), watch,
               {{"output", flags.output}, {"samples", set.samples.size()}}, context);
  return ExitStatus::kDone;
}

template <typename Options, typename Run>
void add_part(Command& parent, Context& context, const char* name, const char* help,
              const Run& run) {
  const auto add_flags = [](Command& verb, PartFlags<Options>& flags) {
    add_learn_flags(verb, flags);
    verb.add_option("--model", flags.model, "tracker file to extend (.json)").required();
    bind_all(verb, flags.options);
  };
  add_verb<PartFlags<Options>>(parent, name, help, context, add_flags, run);
}

using RegressionNetworkFlags = PartFlags<face::regression::RegressionNetworkOptions>;
using VisibilityFlags = PartFlags<face::regression::VisibilityOptions>;

ExitStatus train_network(RegressionNetworkFlags& flags, Context& context) {
  const auto learn = [&](const face::shape::LandmarkSet& set, face::landmarks::LandmarkModel& model,
                         std::vector<std::string>& skipped) {
    const auto faces = face::regression::load_framed_faces(
        set, flags.mirror, context.seed, *context.progress, context.stop, skipped);
    model.network = face::regression::train_regression_network(faces, flags.options,
                                                               *context.progress, context.stop);
  };
  return train_part(flags, context, "network", learn);
}

ExitStatus train_visibility(VisibilityFlags& flags, Context& context) {
  const auto learn = [&](const face::shape::LandmarkSet& set, face::landmarks::LandmarkModel& model,
                         std::vector<std::string>& skipped) {
    model.visibility = face::regression::train_visibility_model(
        set, flags.mirror, flags.options, *context.progress, context.stop, skipped);
  };
  return train_part(flags, context, "visibility", learn);
}

}  // namespace

void add_landmarks_train(Command& area, Context& context) {
  Command& verb = area.add_subcommand("train", "train the models on annotated images");
  verb.require_subcommand(1);
  add_kind(verb, context, "shape", "train the shape model", Kind::kShape);
  add_kind(verb, context, "patches", "train the patch of each landmark", Kind::kPatches);
  add_kind(verb, context, "detector",
           "train the landmark positions relative to a face detector's box", Kind::kDetector);
  add_kind(verb, context, "trees", "train the cascade of regression trees", Kind::kTrees);
  add_kind(verb, context, "tracker", "train all parts into one file", Kind::kTracker);
  add_part<face::regression::RegressionNetworkOptions>(
      verb, context, "network",
      "train a convolutional network on the whole face and add it to a tracker", train_network);
  add_part<face::regression::VisibilityOptions>(
      verb, context, "visibility",
      "train the visibility and expected error of landmarks and add them to a tracker",
      train_visibility);
  add_landmarks_train_detector(verb, context);
  add_landmarks_train_networks(verb, context);
}

}  // namespace tarsier::cli
