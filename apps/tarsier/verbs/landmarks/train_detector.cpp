// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/landmarks/hog_detector.h"
#include "tarsier/face/shape/import.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/stopwatch.h"
#include "verbs/landmarks/train_boxes.h"
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {

std::vector<face::shape::BoxedImage> load_boxes(const SetFlags& flags, int every, Part part) {
  std::vector<face::shape::BoxedImage> images;
  if (flags.input.ends_with(".xml")) {
    face::shape::ImportOptions options;
    options.images = flags.images;
    face::shape::BoxedImages read = face::shape::read_dlib_boxes(flags.input, options);
    for (const std::string& skipped : read.skipped) log_warning("{}; left out", skipped);
    for (std::size_t i = 0; i < read.images.size(); ++i) {
      const bool held_out = every > 0 && (i + 1) % static_cast<std::size_t>(every) == 0;
      if (every <= 0 || held_out == (part == Part::kHeldOut)) {
        images.push_back(std::move(read.images[i]));
      }
    }
  } else {
    images = face::shape::boxes_from_landmarks(part_of(load_set(flags), every, part));
  }
  if (images.empty()) throw InputError(flags.input, "no image is left");
  return images;
}

void add_images_without(const std::string& folder, std::vector<face::shape::BoxedImage>& images) {
  std::vector<std::string> paths;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (entry.is_regular_file(error)) paths.push_back(entry.path().string());
  }
  if (paths.empty()) throw InputError(folder, "is not a folder of images");
  std::sort(paths.begin(), paths.end());
  for (std::string& path : paths) images.push_back({std::move(path), {}, {}, {}});
}

nlohmann::json box_training_provenance(const TrainingFlags& flags, const Context& context) {
  nlohmann::json about = {{"program", fmt::format("tarsier {}", version())},
                          {"seed", context.seed},
                          {"data", std::filesystem::path(flags.set.input).filename().string()},
                          {"terms", flags.terms}};
  if (flags.hold_out > 0) about["left_out"] = fmt::format("every {}th", flags.hold_out);
  return about;
}

void warn_of_skipped(const std::vector<std::string>& skipped) {
  for (const std::string& what : skipped) log_warning("{}; left out", what);
}

namespace {

struct DetectorFlags : TrainingFlags {
  std::string without;
  face::landmarks::HogOptions options;
};

ExitStatus train_face_detector(DetectorFlags& flags, Context& context) {
  const Stopwatch watch;
  flags.options.seed = context.seed;
  std::vector<face::shape::BoxedImage> images =
      load_boxes(flags.set, flags.hold_out, Part::kOthers);
  if (!flags.without.empty()) add_images_without(flags.without, images);
  const face::landmarks::HogTraining trained = face::landmarks::train_hog_detector(
      images, flags.set.input, flags.options, *context.progress, context.stop);
  warn_of_skipped(trained.skipped);
  if (trained.ignored > 0) {
    log_warning(
        "{} boxes are not used for training: smaller than the window (--upsample), cut off by the "
        "image border or of another shape",
        trained.ignored);
  }
  const double seconds = rounded(watch.seconds(), 1);
  const double rate = static_cast<double>(trained.found) / std::max(1, trained.boxes);
  nlohmann::json about = box_training_provenance(flags, context);
  about.update({{"images", trained.images},
                {"boxes", trained.boxes},
                {"c", flags.options.c},
                {"mirrored", flags.options.mirror}});
  face::landmarks::write_hog_detector(flags.output, trained.detector, about);
  if (context.json) {
    const nlohmann::ordered_json line = {{"output", flags.output},
                                         {"images", trained.images},
                                         {"boxes", trained.boxes},
                                         {"ignored", trained.ignored},
                                         {"rounds", trained.rounds},
                                         {"found", rounded(rate, 4)},
                                         {"knows_shapes", trained.detector.box.has_value()},
                                         {"seconds", seconds}};
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format(
        "{}: {} boxes in {} images, window {}x{} px, {} rounds; finds {:.1f} % of them; {} s\n",
        flags.output, trained.boxes, trained.images, trained.detector.width,
        trained.detector.height, trained.rounds, 100 * rate, seconds));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, DetectorFlags& flags) {
  add_training_flags(verb, flags);
  verb.add_option("--without", flags.without,
                  "folder of images without the object; reduces false alarms");
  face::landmarks::HogOptions& options = flags.options;
  bind_all(verb, options);
  verb.add_flag("--mirror,!--no-mirror", options.mirror,
                "add mirrored images to the training set [on]");
}

}  // namespace

void add_landmarks_train_detector(Command& parent, Context& context) {
  add_verb<DetectorFlags>(parent, "face-detector",
                          "train an object detector from boxes (dlib .xml) or landmarks", context,
                          add_flags, train_face_detector);
}

}  // namespace tarsier::cli
