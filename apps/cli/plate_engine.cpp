// SPDX-License-Identifier: MIT
#include "plate_engine.h"

#include "tarsier/plate_text/country.h"

#include <algorithm>
#include <filesystem>
#include <memory>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

std::string model_path(const std::string& given, const char* name) {
  if (!given.empty()) return given;
  const std::string folder = find_models_folder("");
  if (folder.empty())
    throw ModelError(name, "no folder of models was found: set TARSIER_MODELS to it");
  return (fs::path(folder) / name).string();
}

// What the user did not ask for.
void trim(std::vector<plate::Reading>& readings, double least, int top) {
  std::erase_if(readings, [&](const plate::Reading& r) { return r.confidence < least; });
  for (plate::Reading& reading : readings) {
    if (reading.candidates.size() > static_cast<std::size_t>(top))
      reading.candidates.resize(static_cast<std::size_t>(top));
  }
}

}  // namespace

void add_plate_flags(Command& verb, PlateFlags& flags) {
  verb.add_option("--country", flags.countries,
                  "es, sk, us .. or a group (eu); several allowed; any: all that are known")
      .delimiter(',')
      .type_name("CODE");
  verb.add_option("--pipeline", flags.pipeline, "default: networks; classic: the textbook's")
      .check(one_of({"default", "classic"}))
      .show_default();
  verb.add_option("--top", flags.top, "candidates of each plate")
      .check(range(1, 100))
      .show_default();
  verb.add_option("--min-confidence", flags.least_confidence, "leave out plates below, 0..1")
      .check(range(0.0, 1.0))
      .show_default();
  const auto model = [](Flag& flag) { flag.group("Models"); };
  model(verb.add_option("--detector", flags.detector, "file; default: what ships"));
  model(verb.add_option("--reader,--model", flags.reader, "file; default: what ships"));
  model(verb.add_option("--countries-dir", flags.countries_folder,
                        "folder of layouts (*.txt); default: what ships"));
  model(verb.add_option("--classic-reader", flags.classic_reader, "mlp: the textbook's; hog")
            .check(one_of({"mlp", "hog"}))
            .show_default());
  const auto tune = [](Flag& flag) { flag.show_default().group("Finding and decoding"); };
  tune(verb.add_option("--find-threshold", flags.recognizer.detector.threshold,
                       "of the detector, (0, 1); lower: more, slower"));
  tune(verb.add_option("--find-pixels", flags.recognizer.detector.max_pixels,
                       "larger pictures are searched at this many; more: smaller plates, slower"));
  tune(verb.add_option("--plate-threshold", flags.recognizer.least_plate,
                       "of the aligner's plate score, (0, 1)"));
  tune(verb.add_option("--evidence", flags.recognizer.least_evidence,
                       "ln(confidence) + logit(plate) of what is told; lower: more, of which more "
                       "are none"));
  tune(verb.add_option("--free-penalty", flags.decoding.free_penalty,
                       "nats against texts that fit no country's layout, 0..50"));
}

std::shared_ptr<const plate::Recognizer> make_recognizer(const PlateFlags& flags,
                                                         const Context& context) {
  plate::DecodeOptions decoding = flags.decoding;
  decoding.candidates = std::max(decoding.candidates, flags.top);
  const std::string folder =
      flags.countries_folder.empty() ? model_path("", "countries") : flags.countries_folder;
  plate::CountryChoice choice =
      plate::choose_countries(plate::read_countries(folder), flags.countries);
  plate::RecognizerOptions options = flags.recognizer;
  options.parallel = context.threads != 1;
  return std::make_shared<const plate::Recognizer>(
      plate::read_detector_model(model_path(flags.detector, "plate-detector.json")),
      plate::read_reader_model(model_path(flags.reader, "plate-reader.json")), std::move(choice),
      options, decoding);
}

PlateReader make_plate_reader(const PlateFlags& flags, const Context& context) {
  if (flags.pipeline == "classic") {
    const bool mlp = flags.classic_reader == "mlp";
    const auto classic = plate::read_classic_model(
        model_path(flags.detector, "plate-svm.json"),
        model_path(flags.reader, mlp ? "plate-mlp.json" : "plate-hog.json"));
    plate::ClassicOptions options;
    options.seed = context.seed;
    options.check();
    return [classic, options, least = flags.least_confidence, top = flags.top](const Frame& frame,
                                                                               DebugSink* debug) {
      auto readings = plate::read_classic(frame.image, *classic, options, debug);
      trim(readings, least, top);
      return readings;
    };
  }
  const auto recognizer = make_recognizer(flags, context);
  return [recognizer, least = flags.least_confidence, top = flags.top](const Frame& frame,
                                                                       DebugSink* debug) {
    auto readings = recognizer->read(frame.image, debug, nullptr, !frame.still);
    trim(readings, least, top);
    return readings;
  };
}

}  // namespace tarsier::cli
