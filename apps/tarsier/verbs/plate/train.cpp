// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/model_store.h"
#include "tarsier/plate/networks/recognizer.h"
#include "tarsier/plate/text/country.h"
#include "tarsier/plate/train/training.h"
#include "tarsier/plate/train/whole_image_fit.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <opencv2/core/utility.hpp>

#include "framework/bind.h"
#include "verbs/plate/plate.h"
#include "verbs/plate/train_classic.h"
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

// Offset of the seed to that of the training typefaces.
constexpr std::uint64_t kHeldOutSeedOffset = 1000;

struct PlateTrainFlags {
  std::vector<std::string> inputs;
  std::vector<std::string> scenes;
  std::vector<std::string> found;
  std::string output;
  std::string detector;
  std::string countries;
  std::string from;
  std::string pipeline = "default";
  std::string terms;
  plate::TrainingOptions options;
  int calibration = 3000;
  bool confidence_only = false;
  bool wild = false;
  double hold_out = 0;
  ClassicTrainFlags classic;
};

plate::ViewGenerator view_maker(const std::vector<std::string>& folders,
                                std::shared_ptr<const synth::GlyphSet> glyphs) {
  plate::ViewGenerator views;
  for (const std::string& folder : folders) {
    std::vector<plate::Scene> scenes = plate::read_scenes(folder, 1e6);
    std::size_t plates = 0;
    for (const plate::Scene& scene : scenes) plates += scene.plates.size();
    log_info("{}: {} images, {} plates", folder, scenes.size(), plates);
    std::move(scenes.begin(), scenes.end(), std::back_inserter(views.scenes));
  }
  views.glyphs = std::move(glyphs);
  return views;
}

std::shared_ptr<const synth::GlyphSet> glyphs_of(const PlateTrainFlags& flags, std::uint64_t seed) {
  return flags.wild ? synth::load_many_glyphs(seed) : synth::load_glyphs();
}

// The last two names of each path.
std::vector<std::string> short_names(const std::vector<std::string>& paths) {
  std::vector<std::string> result;
  for (const std::string& path : paths) {
    const fs::path clean = fs::path(path).lexically_normal();
    const fs::path last = clean.has_filename() ? clean : clean.parent_path();
    result.push_back((last.parent_path().filename() / last.filename()).string());
  }
  return result;
}

nlohmann::json provenance(const PlateTrainFlags& flags, const Context& context) {
  return {{"program", fmt::format("tarsier {}", version())},
          {"seed", context.seed},
          {"scenes", short_names(flags.scenes)},
          {"inputs", short_names(flags.inputs)},
          {"drawn_plates", true},
          {"wild", flags.wild},
          {"terms", flags.terms}};
}

ExitStatus train_plate_detector(PlateTrainFlags& flags, Context& context) {
  if (flags.pipeline == "classic") {
    flags.classic.inputs = flags.inputs;
    flags.classic.output = flags.output;
    flags.classic.terms = flags.terms;
    return train_classic_detector(flags.classic, context);
  }
  flags.options.seed = context.seed;
  flags.options.check();
  flags.scenes = flags.inputs;
  plate::ViewGenerator views = view_maker(flags.inputs, glyphs_of(flags, context.seed));
  views.wild = flags.wild;
  plate::DetectorModel model;
  model.detector = plate::train_detector(views, flags.options, *context.progress, context.stop);
  views.hard_negatives = plate::find_hard_negatives(views.scenes, model.detector);
  log_info("{} false detections are used as negative examples", views.hard_negatives.size());
  model.aligner = plate::train_aligner(views, flags.options, *context.progress, context.stop);
  flags.inputs.clear();
  plate::write_detector_model(flags.output, model, provenance(flags, context));
  return ExitStatus::kDone;
}

ExitStatus train_reader(PlateTrainFlags& flags, Context& context) {
  if (flags.pipeline == "classic") {
    flags.classic.inputs = flags.inputs;
    flags.classic.output = flags.output;
    flags.classic.terms = flags.terms;
    return train_classic_reader(flags.classic, context);
  }
  flags.options.seed = context.seed;
  flags.options.check();
  if (flags.confidence_only) {
    flags.found.insert(flags.found.begin(), flags.inputs.begin(), flags.inputs.end());
    flags.inputs.clear();
  }
  if (flags.scenes.empty() && !(flags.confidence_only && flags.calibration == 0))
    throw UsageError("--scenes: expected images, into which the synthetic plates are drawn");
  const ModelStore models = ModelStore::find();
  std::optional<plate::ReaderModel> start;
  nlohmann::json before;  // provenance of a start model's characters, if they are kept
  if (!flags.from.empty()) {
    const bool ships = flags.from.find_first_of("/.") == std::string::npos;
    const std::string path = ships ? models.path(flags.from + ".json") : flags.from;
    start = plate::read_reader_model(path);
    if (flags.confidence_only) before = read_any_archive(path).provenance;
  }
  plate::DetectorModel detector_model;
  if (flags.calibration > 0 || !flags.found.empty()) {
    detector_model =
        plate::read_detector_model(models.path_or(flags.detector, "plate-detector.json"));
  }
  plate::ViewGenerator views = view_maker(flags.scenes, glyphs_of(flags, context.seed));
  views.wild = flags.wild;
  std::vector<plate::LabelledCrop> crops;
  for (const std::string& folder : flags.inputs) {
    auto more = plate::read_labelled_crops(folder);
    log_info("{}: {} labelled plates", folder, more.size());
    std::move(more.begin(), more.end(), std::back_inserter(crops));
  }
  // The order of the crops affects the training: without --hold-out it is that of the folders.
  plate::CropSplit split;
  if (flags.hold_out > 0) {
    split = plate::split_crops(std::move(crops), flags.hold_out, Rng(context.seed).fork(7));
  } else {
    split.train = std::move(crops);
  }
  plate::ReaderModel model;
  if (start) model = *start;
  if (!flags.confidence_only) {
    model.line = plate::train_line_reader(views, split.train, flags.options, *context.progress,
                                          context.stop, start ? &start->line : nullptr);
  }
  nlohmann::json learnt_from = provenance(flags, context);
  if (start) learnt_from["from"] = fs::path(flags.from).filename().string();
  if (start && flags.options.keep > 0) learnt_from["keep"] = flags.options.keep;
  if (!split.test.empty()) {
    const plate::CharacterErrors errors = plate::evaluate_line_reader(model.line, split.test);
    log_info("{} plates held out: {} of {} characters read wrong ({:.2f} %)", split.test.size(),
             errors.wrong, errors.characters, 100.0 * errors.wrong / errors.characters);
    learnt_from["held_out"] = {
        {"plates", split.test.size()}, {"characters", errors.characters}, {"wrong", errors.wrong}};
  }
  const auto countries = [&] {
    return plate::choose_countries(plate::read_countries(models.path("countries")), {});
  };
  if (flags.calibration > 0) {
    model.confidence_curve = model.character_curve = {};  // they belong to another model
    const plate::Recognizer recognizer(detector_model, model, countries());
    // Typefaces outside the training set, like those that the model will meet.
    views.glyphs = glyphs_of(flags, context.seed + kHeldOutSeedOffset);
    model.calibration = plate::fit_calibration(recognizer, views, flags.calibration,
                                               context.seed + 99, *context.progress, context.stop);
  }
  if (!flags.found.empty()) {
    const plate::WholeImageCounts counts = plate::fit_to_whole_images(
        detector_model, countries(), flags.found, model, *context.progress, context.stop);
    log_info(
        "{} detections in {} images, {} of them plates; of {} known texts {} were read correctly",
        counts.detections, counts.images, counts.plates, counts.texts, counts.correct);
    learnt_from["found"] = short_names(flags.found);
  }
  if (before.is_object()) {
    before["confidence"] = std::move(learnt_from);
    learnt_from = std::move(before);
  }
  plate::write_reader_model(flags.output, model, learnt_from);
  return ExitStatus::kDone;
}

void add_shared(Command& verb, PlateTrainFlags& flags) {
  verb.add_option("-o,--output", flags.output, "output model file").required();
  verb.add_flag("--wild", flags.wild,
                "use worn and degraded synthetic plates in 200 random typefaces (by --seed)");
  verb.add_option("--terms", flags.terms, "terms of use of the data, stored in the model");
  verb.add_option("--pipeline", flags.pipeline,
                  "default: neural networks; classic: the textbook pipeline (SVM, MLP)")
      .check(one_of({"default", "classic"}))
      .show_default();
}

void add_detector_flags(Command& verb, PlateTrainFlags& flags) {
  verb.add_option("INPUT", flags.inputs,
                  "folders with truth.csv (image,x,y,w,h,text) or without plates; classic: "
                  "SVM.xml, or plate/ and no-plate/")
      .required()
      .type_name("");
  add_shared(verb, flags);
  bind_field(verb, flags.options, flags.options.detector_steps);
  bind_field(verb, flags.options, flags.options.aligner_steps);
  add_classic_detector_flags(verb, flags.classic);
}
void add_reader_flags(Command& verb, PlateTrainFlags& flags) {
  verb.add_option("INPUT", flags.inputs,
                  "folders of plates NUMBER_KIND-TEXT.jpg with .txt (class cx cy w h); classic: "
                  "OCR.xml or class folders")
      .type_name("");
  add_shared(verb, flags);
  verb.add_option("--scenes", flags.scenes, "folders of background images for synthetic plates")
      .type_name("");
  verb.add_option("--found", flags.found,
                  "folders of images with truth.csv or without plates, to calibrate the confidence "
                  "on detections")
      .type_name("");
  verb.add_option("--detector", flags.detector,
                  "detector model for the confidence calibration [the shipped model]");
  Flag& from = verb.add_option("--from", flags.from,
                               "model to continue from: file, or plate-reader (shipped); a new "
                               "typeface takes a few hundred steps");
  verb.add_flag("--confidence-only", flags.confidence_only,
                "only recalibrate the confidence: on synthetic plates (--calibration) and "
                "detections in INPUT")
      .needs(from);
  bind_field(verb, flags.options, flags.options.line_steps);
  bind_field(verb, flags.options, flags.options.keep).needs(from);
  verb.add_option("--calibration", flags.calibration,
                  "number of synthetic plates for the confidence calibration; 0: no calibration")
      .show_default();
  verb.add_option("--hold-out", flags.hold_out,
                  "share of the labelled plates held out for evaluation, 0..0.9")
      .check(range(0.0, 0.9))
      .show_default();
  add_classic_reader_flags(verb, flags.classic);
}

}  // namespace

void add_plate_train(Command& plate, Context& context) {
  add_verb<PlateTrainFlags>(plate, "train-detector",
                            "train the plate detector on labelled images and synthetic plates",
                            context, add_detector_flags, train_plate_detector);
  add_verb<PlateTrainFlags>(plate, "train-reader",
                            "train the character reader on labelled and synthetic plates", context,
                            add_reader_flags, train_reader);
}

}  // namespace tarsier::cli
