// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/face_training.h"
#include "tarsier/face/landmarks/face_finder.h"

#include <fmt/format.h>

#include "cmd_landmarks_train_boxes.h"
#include "framework/stopwatch.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct NetworkFlags : BoxTrainingFlags {
  std::vector<std::string> without;
  face::FaceTrainingOptions options;
};

// Boxes as the cascade draws them where the points of the face are known, else as they are given.
face::FacePicture face_picture(face::shape::BoxedPicture picture) {
  face::FacePicture result;
  result.image = std::move(picture.image);
  result.ignored = std::move(picture.ignored);
  for (std::size_t i = 0; i < picture.boxes.size(); ++i) {
    const bool known = i < picture.shapes.size() && picture.shapes[i].cols() == 68 &&
                       picture.shapes[i].allFinite();
    result.faces.push_back(
        known ? face::landmarks::box_around(face::landmarks::cascade_box(), picture.shapes[i])
              : picture.boxes[i]);
  }
  return result;
}

ExitStatus train_networks(NetworkFlags& flags, Context& context) {
  const Stopwatch watch;
  flags.options.seed = context.seed;
  std::vector<face::shape::BoxedPicture> boxed =
      load_boxes(flags.set, flags.hold_out, Part::kOthers);
  for (const std::string& folder : flags.without) add_pictures_without(folder, boxed);
  std::vector<face::FacePicture> pictures;
  for (face::shape::BoxedPicture& picture : boxed)
    pictures.push_back(face_picture(std::move(picture)));
  const face::FaceTraining trained = face::train_face_networks(
      pictures, flags.set.input, flags.options, *context.progress, context.stop);
  warn_of_skipped(trained.skipped);
  const double seconds = rounded(watch.seconds(), 1);
  nlohmann::json about = box_training_provenance(flags, context);
  about.update({{"faces", trained.faces},
                {"without", trained.without},
                {"drawings", flags.options.drawings},
                {"held_out", trained.held_out},
                {"held_out_alarms", trained.held_out_alarms}});
  face::write_face_networks(flags.output, trained.networks, about);
  if (context.json) {
    const nlohmann::ordered_json line = {
        {"output", flags.output},
        {"faces", trained.faces},
        {"without", trained.without},
        {"sure", trained.networks.sure},
        {"held_out", trained.held_out},
        {"held_out_alarms", trained.held_out_alarms},
        {"mistakes", {trained.scan_mistakes, trained.judge_mistakes, trained.check_mistakes}},
        {"seconds", seconds}};
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format(
        "{}: {} faces, {} pictures without; mistakes learned from: {}, {}, {}; {} s\n"
        "a face is sure from a score of {:.3f} on: {} false in {} pictures that were held out\n",
        flags.output, trained.faces, trained.without, trained.scan_mistakes, trained.judge_mistakes,
        trained.check_mistakes, seconds, trained.networks.sure, trained.held_out_alarms,
        trained.held_out));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, NetworkFlags& flags) {
  add_box_training_flags(verb, flags);
  verb.add_option(
          "--without", flags.without,
          "folders of pictures that show no face: what they learn not to find; every fourth "
          "decides what is sure")
      .required();
  verb.add_option("--false-alarms", flags.options.false_alarms,
                  "how many there may be in 1000 of the pictures held out")
      .check(range(0, 10000))
      .show_default();
  verb.add_option("--drawings", flags.options.drawings,
                  "pictures without faces that the program draws and learns from as well")
      .check(range(0, 10000))
      .show_default();
  const auto add_steps = [&](const char* name, int& steps, const char* help) {
    verb.add_option(name, steps, help).check(range(3, 1000000)).show_default();
  };
  add_steps("--scan-steps", flags.options.scan_steps, "batches that the first network learns from");
  add_steps("--judge-steps", flags.options.judge_steps, "batches of the second");
  add_steps("--check-steps", flags.options.check_steps, "batches of the third");
}

}  // namespace

void add_landmarks_train_networks(Command& parent, Context& context) {
  add_verb<NetworkFlags>(parent, "face-networks",
                         "the networks that find faces of any size, from boxes or landmarks",
                         context, add_flags, train_networks);
}

}  // namespace tarsier::cli
