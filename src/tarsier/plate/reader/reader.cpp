// SPDX-License-Identifier: MIT
#include "tarsier/plate/reader/reader.h"

#include "tarsier/plate/networks/reading_json.h"
#include "tarsier/plate/text/country.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::plate {

void ReaderOptions::check() const {
  check_fields(*this);
  recognizer.check();
  decoding.check();
  textbook.check();
}

nlohmann::ordered_json to_json(const ReaderResult& result) {
  nlohmann::ordered_json plates = nlohmann::ordered_json::array();
  for (const Reading& reading : result.plates) plates.push_back(reading_json(reading));
  return {{"plates", std::move(plates)}, {"ms", std::round(result.ms * 100) / 100}};
}

Recognizer load_recognizer(const ModelStore& models, const ReaderOptions& options) {
  options.check();
  DecodeOptions decoding = options.decoding;
  decoding.candidates = std::max(decoding.candidates, options.max_candidates);
  const std::string folder = models.path_or(options.countries_folder, "countries");
  CountryChoice choice = choose_countries(read_countries(folder), options.countries);
  return {read_detector_model(models.path_or(options.detector_model, "plate-detector.json")),
          read_reader_model(models.path_or(options.reader_model, "plate-reader.json")),
          std::move(choice), options.recognizer, decoding};
}

Reader::Reader(Read read, const ReaderOptions& options)
    : read_(std::move(read)),
      min_confidence_(options.min_confidence),
      max_candidates_(static_cast<std::size_t>(options.max_candidates)) {}

Reader Reader::load(const ModelStore& models, const ReaderOptions& options) {
  options.check();
  if (options.pipeline == Pipeline::kNetworks) {
    const auto recognizer = std::make_shared<const Recognizer>(load_recognizer(models, options));
    return {
        [recognizer](const Frame& frame, DebugSink* debug, Timers* timers, const cv::Rect& region) {
          return recognizer->read(frame.image, debug, timers, !frame.still, region);
        },
        options};
  }
  const bool mlp = options.textbook_reader == ReaderKind::kMlp;
  const auto model = read_classic_model(
      models.path_or(options.detector_model, "plate-svm.json"),
      models.path_or(options.reader_model, mlp ? "plate-mlp.json" : "plate-hog.json"));
  return {[model, textbook = options.textbook](const Frame& frame, DebugSink* debug, Timers*,
                                               const cv::Rect&) {
            return read_classic(frame.image, *model, textbook, debug);
          },
          options};
}

ReaderResult Reader::process(const Frame& frame, DebugSink* debug, Timers* timers,
                             const cv::Rect& region) const {
  const auto start = std::chrono::steady_clock::now();
  ReaderResult result;
  result.plates = read_(frame, debug, timers, region);
  std::erase_if(result.plates,
                [this](const Reading& plate) { return plate.confidence < min_confidence_; });
  for (Reading& plate : result.plates) {
    if (plate.candidates.size() > max_candidates_) plate.candidates.resize(max_candidates_);
  }
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - start;
  result.ms = spent.count();
  return result;
}

}  // namespace tarsier::plate
