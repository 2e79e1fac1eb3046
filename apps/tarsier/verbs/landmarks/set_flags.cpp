// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/shape/import.h"
#include "tarsier/face/shape/text_files.h"

#include <fmt/format.h>

#include "verbs/landmarks/landmarks.h"

namespace tarsier::cli {

void add_set_flags(Command& verb, SetFlags& flags) {
  verb.add_option("SET", flags.input,
                  "annotated images: set of `landmarks annotate` (.yaml, .json), folder, list, "
                  ".pts, .asf, .csv or .xml")
      .required();
  verb.add_option("--offset", flags.offset,
                  "offset subtracted from the coordinates of .pts files, px")
      .show_default();
  verb.add_option("--images", flags.images, "folder of the images, if different");
}

void add_training_flags(Command& verb, TrainingFlags& flags, std::string_view eval) {
  add_set_flags(verb, flags.set);
  verb.add_option("-o,--output", flags.output, "output model file (.json)").required();
  verb.add_option("--terms", flags.terms, "terms of use of the data, stored in the model");
  verb.add_option("--hold-out", flags.hold_out,
                  fmt::format("hold out every N-th sample, for `{} --held-out N`; 0: none", eval))
      .check(range(0, 1000000))
      .show_default();
}

face::shape::LandmarkSet load_set(const SetFlags& flags) {
  const auto ends = [&](std::string_view ending) { return flags.input.ends_with(ending); };
  if (ends(".yaml") || ends(".yml") || ends(".json")) {
    face::shape::LandmarkSet set = face::shape::read_landmark_set(flags.input);
    // Makes paths relative to the current folder.
    for (face::shape::LandmarkSample& sample : set.samples) {
      sample.image = face::shape::image_path(flags.input, sample);
    }
    return set;
  }
  if (ends(".txt") && face::shape::is_text_shapes(flags.input)) {
    face::shape::LandmarkSet set;
    for (const Eigen::Matrix2Xd& points : face::shape::read_text_shapes(flags.input)) {
      set.samples.emplace_back();
      set.samples.back().points = points;
    }
    if (const auto markup = face::shape::known_markup(set.points())) {
      set.mirror = markup->mirror;
      set.connections = markup->connections;
    }
    return set;
  }
  face::shape::ImportOptions options;
  options.pts_offset = flags.offset;
  options.images = flags.images;
  face::shape::Imported imported = face::shape::import_landmarks(flags.input, options);
  for (const std::string& skipped : imported.skipped) log_warning("{}; left out", skipped);
  return std::move(imported.set);
}

std::array<int, 2> outer_eyes_of(const std::vector<int>& eyes, int points) {
  if (!eyes.empty()) {
    for (const int eye : eyes) {
      if (eye < 0 || eye >= points)
        throw UsageError(fmt::format("--eyes {}: the set has points 0..{}", eye, points - 1));
    }
    return {eyes[0], eyes[1]};
  }
  const auto markup = face::shape::known_markup(points);
  if (!markup || markup->outer_eyes[0] < 0)
    throw UsageError(fmt::format(
        "--eyes A,B: unknown markup of {} points; give the two outer eye corners", points));
  return markup->outer_eyes;
}

face::shape::LandmarkSet part_of(const face::shape::LandmarkSet& set, int every, Part part) {
  if (every <= 0) return set;
  face::shape::LandmarkSet result;
  result.mirror = set.mirror;
  result.connections = set.connections;
  for (std::size_t i = 0; i < set.samples.size(); ++i) {
    const bool held_out = (i + 1) % static_cast<std::size_t>(every) == 0;
    if (held_out == (part == Part::kHeldOut)) result.samples.push_back(set.samples[i]);
  }
  return result;
}

}  // namespace tarsier::cli
