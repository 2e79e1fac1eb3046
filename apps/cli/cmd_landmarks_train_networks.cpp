// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/face_training.h"
#include "tarsier/landmarks/face_finder.h"

#include <fmt/format.h>

#include "cmd_landmarks.h"
#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct NetworkFlags {
  SetFlags set;
  std::string output;
  std::string terms;
  std::vector<std::string> without;
  int hold_out = 0;
  FaceTrainingOptions options;
};

// Boxes as the cascade draws them where the points of the face are known, else as they are given.
FacePicture face_picture(shape::BoxedPicture picture) {
  FacePicture result;
  result.image = std::move(picture.image);
  result.ignored = std::move(picture.ignored);
  for (std::size_t i = 0; i < picture.boxes.size(); ++i) {
    const bool known = i < picture.shapes.size() && picture.shapes[i].cols() == 68 &&
                       picture.shapes[i].allFinite();
    result.faces.push_back(known
                               ? landmarks::box_around(landmarks::cascade_box(), picture.shapes[i])
                               : picture.boxes[i]);
  }
  return result;
}

ExitStatus train_networks(NetworkFlags& flags, Context& context) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  flags.options.seed = context.seed;
  std::vector<shape::BoxedPicture> boxed = load_boxes(flags.set, flags.hold_out, Part::kOthers);
  for (const std::string& folder : flags.without) add_pictures_without(folder, boxed);
  std::vector<FacePicture> pictures;
  for (shape::BoxedPicture& picture : boxed) pictures.push_back(face_picture(std::move(picture)));
  const FaceTraining trained = train_face_networks(pictures, flags.set.input, flags.options,
                                                   *context.progress, context.stop);
  for (const std::string& skipped : trained.skipped) log_warning("{}; left out", skipped);
  const double seconds =
      std::round(std::chrono::duration<double>(Clock::now() - start).count() * 10) / 10;
  nlohmann::json about = {{"program", fmt::format("tarsier {}", version())},
                          {"seed", context.seed},
                          {"data", std::filesystem::path(flags.set.input).filename().string()},
                          {"faces", trained.faces},
                          {"without", trained.without},
                          {"terms", flags.terms}};
  if (flags.hold_out > 0) about["left_out"] = fmt::format("every {}th", flags.hold_out);
  write_face_networks(flags.output, trained.networks, about);
  if (context.json) {
    const nlohmann::ordered_json line = {
        {"output", flags.output},
        {"faces", trained.faces},
        {"without", trained.without},
        {"mistakes", {trained.scan_mistakes, trained.judge_mistakes, trained.check_mistakes}},
        {"seconds", seconds}};
    print_json_line(line.dump());
  } else if (!context.quiet) {
    print_text(
        fmt::format("{}: {} faces, {} pictures without; mistakes learned from: {}, {}, {}; {} s\n",
                    flags.output, trained.faces, trained.without, trained.scan_mistakes,
                    trained.judge_mistakes, trained.check_mistakes, seconds));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, NetworkFlags& flags) {
  add_set_flags(verb, flags.set);
  verb.add_option("-o,--output", flags.output, "model file to write (.json)").required();
  verb.add_option("--terms", flags.terms, "terms of the data, kept in the model");
  verb.add_option("--hold-out", flags.hold_out,
                  "leave out every N-th sample, for `landmarks eval --held-out N`; 0: none")
      .check(range(0, 1000000))
      .show_default();
  verb.add_option("--without", flags.without,
                  "folders of pictures that show no face: what they learn not to find")
      .required();
  const auto add_steps = [&](const char* name, int& steps, const char* help) {
    verb.add_option(name, steps, help).check(range(2, 1000000)).show_default();
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
