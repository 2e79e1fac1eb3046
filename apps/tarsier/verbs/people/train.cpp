// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/training.h"

#include <fmt/format.h>

#include "framework/size_flag.h"
#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

struct PeopleTrainFlags {
  PeopleFlags people;
  std::string list;
  std::string background_list;
  std::string terms;
  std::string algorithm;
  std::string size;
  bool raw = false;
  std::string output;
};

face::recognition::Algorithm algorithm_of(const std::string& name) {
  try {
    return face::recognition::parse_algorithm(name);
  } catch (const std::invalid_argument& error) {
    throw UsageError(fmt::format("--algorithm: {}", error.what()));
  }
}

// Of very many faces, an evenly spaced subset is used.
std::int64_t learned_from(const face::recognition::Recognizer& model) {
  return std::min<std::int64_t>(model.templates.rows(), face::recognition::kMaxTrainingFaces);
}

void print_result(const face::recognition::Recognizer& model, const Context& context,
                  const std::string& location) {
  const auto& calibration = model.calibration;
  if (context.json) {
    nlohmann::ordered_json line = {
        {"algorithm", face::recognition::name_of(model.options.algorithm)},
        {"people", model.labels.size()},
        {"faces", model.templates.rows()},
        {"learned_from", learned_from(model)},
        {"calibrated", calibration.has_value()}};
    if (calibration) {
      line["strangers"] = {{"scores", calibration->impostor_scores},
                           {"people", calibration->impostor_people}};
      line["genuine_scores"] = calibration->genuine_scores;
      line["threshold_1_percent"] =
          calibration->threshold(0.01, static_cast<int>(model.labels.size()));
    }
    line["output"] = location;
    print_json(line);
    return;
  }
  std::string text =
      fmt::format("{}: {} people, {} faces, learned from {} -> {}\n",
                  face::recognition::name_of(model.options.algorithm), model.labels.size(),
                  model.templates.rows(), learned_from(model), printable(location));
  if (calibration) {
    text += fmt::format(
        "  threshold for 1 false accept in 100: {:.3f}; from {} impostor scores of {} held-out "
        "people{} and {} genuine scores\n",
        calibration->threshold(0.01, static_cast<int>(model.labels.size())),
        calibration->impostor_scores, calibration->impostor_people,
        calibration->impostor_scores < 100 ? " (few: combined with the background's statistics)"
                                           : "",
        calibration->genuine_scores);
  } else {
    text += "  no threshold: no impostor scores (more people or a background needed)\n";
  }
  print_text(text);
}

bool uses_deep_templates(const PeopleTrainFlags& flags) {
  return template_kind(flags.people) == face::TemplateKind::kDeep;
}

ExitStatus train_background(const PeopleTrainFlags& flags, Context& context) {
  face::recognition::BackgroundOptions options;
  options.seed = context.seed;
  if (uses_deep_templates(flags)) {
    options.network = face::load_deep_network(ModelStore::find(), own_network(flags.people));
    // A gallery's own scatter is less reliable than the network's training.
    options.within_weight = 200;
  }
  face::people::FaceReader reader = make_face_reader(flags.people);
  const ListedFaces listed =
      read_listed_faces(flags.background_list, flags.raw, {}, false, &reader, context);
  face::recognition::Background background;
  try {
    background =
        face::recognition::learn_background(listed.faces, options, *context.progress, context.stop);
  } catch (const std::invalid_argument& error) {
    throw InputError(flags.background_list, error.what());
  }
  const std::filesystem::path input =
      std::filesystem::path(flags.background_list).lexically_normal();
  face::recognition::write_background(
      flags.output, background,
      {{"program", fmt::format("tarsier {}", version())},
       {"seed", context.seed},
       {"data", input.parent_path().filename().string() + "/" + input.filename().string()},
       {"faces", listed.faces.size()},
       {"not_found", listed.missed.size()},
       {"options",
        {{"components", options.components},
         {"variants", options.variants},
         {"relight", options.relight},
         {"moved_px", options.moved_px},
         {"weight", options.weight},
         {"within_weight", options.within_weight}}},
       {"terms", flags.terms}});
  print_text(fmt::format("{} people, {} directions -> {}\n", listed.faces.size(),
                         background.basis.rows(), printable(flags.output)));
  return ExitStatus::kDone;
}

ExitStatus train_list(const PeopleTrainFlags& flags, Context& context) {
  using face::recognition::Algorithm;
  face::recognition::RecognizerOptions options;
  if (!flags.algorithm.empty()) options.algorithm = algorithm_of(flags.algorithm);
  if (uses_deep_templates(flags)) options.algorithm = Algorithm::kDeep;
  const bool classical = !face::recognition::is_whitened(options.algorithm);
  std::optional<face::recognition::Background> background;
  if (options.algorithm == Algorithm::kDeep)
    background = find_deep_background(flags.people);
  else if (!flags.raw && !classical)
    background = find_background(flags.people);
  std::optional<face::people::FaceReader> reader;
  if (!flags.raw) reader.emplace(make_face_reader(flags.people));
  const cv::Size size = flags.size.empty() ? cv::Size() : parse_size(flags.size, 8, 1024);
  const ListedFaces listed = read_listed_faces(flags.list, flags.raw, size, classical,
                                               reader ? &*reader : nullptr, context);
  for (const std::string& path : listed.missed) log_warning("{}: no face", path);
  face::recognition::Recognizer model;
  try {
    model = face::recognition::train(listed.faces, listed.labels, options, *context.progress,
                                     context.stop, background ? &*background : nullptr);
  } catch (const std::invalid_argument& error) {
    throw InputError(flags.list, error.what());
  }
  face::recognition::write_recognizer(flags.output, model,
                                      {{"program", fmt::format("tarsier {}", version())},
                                       {"raw", flags.raw},
                                       {"faces", listed.faces.size()}});
  print_result(model, context, flags.output);
  return ExitStatus::kDone;
}

ExitStatus train_gallery(const PeopleTrainFlags& flags, Context& context) {
  face::people::Gallery gallery = face::open_gallery_to_write(flags.people.gallery);
  if (!flags.algorithm.empty()) {
    gallery.set_algorithm(face::recognition::name_of(algorithm_of(flags.algorithm)));
  } else if (uses_deep_templates(flags)) {
    const face::SharedNetwork own = own_network(flags.people);
    static_cast<void>(face::load_deep_network(ModelStore::find(), own));
    if (own) static_cast<void>(find_deep_background(flags.people));
    face::use_deep_templates(gallery, own);
  } else if (template_kind(flags.people) == face::TemplateKind::kClassic &&
             face::has_deep_templates(gallery)) {
    gallery.set_algorithm("default");
    gallery.set_network("");
  }
  const auto model =
      model_of_gallery(gallery, flags.people, context, face::people::TrainingPolicy::kAlways);
  if (!model) {
    log_info("{}: nobody is enrolled", flags.people.gallery);
    return ExitStatus::kNothingFound;
  }
  if (!flags.output.empty()) {
    face::recognition::write_recognizer(flags.output, *model,
                                        {{"program", fmt::format("tarsier {}", version())}});
  }
  print_result(*model, context, flags.output.empty() ? flags.people.gallery : flags.output);
  return ExitStatus::kDone;
}

ExitStatus train_people(const PeopleTrainFlags& flags, Context& context) {
  if (uses_deep_templates(flags) && !flags.algorithm.empty() && flags.algorithm != "deep")
    throw UsageError("--template deep (or --embedding) or --algorithm, not both");
  if (!flags.list.empty() && !flags.background_list.empty())
    throw UsageError("--list or --learn-background, not both");
  const bool listed = !flags.list.empty() || !flags.background_list.empty();
  if (listed && flags.output.empty()) throw UsageError("-o: name the model file to write");
  if (!listed && (flags.raw || !flags.size.empty()))
    throw UsageError("--raw and --size need --list");
  if (!flags.background_list.empty()) return train_background(flags, context);
  return listed ? train_list(flags, context) : train_gallery(flags, context);
}

void add_flags(Command& verb, PeopleTrainFlags& flags) {
  add_gallery_flag(verb, flags.people);
  verb.add_option(
      "--list", flags.list,
      "list of images, path<TAB>label a line; optionally four more columns: the eyes x y x y");
  verb.add_option("--algorithm", flags.algorithm,
                  "algorithm: default, eigen, fisher, lbph or deep; stored in the gallery");
  verb.add_flag("--raw", flags.raw, "the list's images are face crops already");
  verb.add_option("--size", flags.size, "size of the list's resized images: 42x48");
  verb.add_option("-o,--output", flags.output, "output model file");
  verb.add_option("--learn-background", flags.background_list,
                  "train the background model from a list of many people, one image each");
  verb.add_option("--terms", flags.terms,
                  "terms of use of the images of --learn-background, stored in the model");
  add_face_flags(verb, flags.people);
}

}  // namespace

void add_people_train(Command& area, Context& context) {
  add_verb<PeopleTrainFlags>(
      area, "train", "train the recogniser of the gallery, or a model from a list of images",
      context, add_flags, train_people);
}

}  // namespace tarsier::cli
