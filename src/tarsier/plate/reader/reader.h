// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/timer.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/model_store.h"
#include "tarsier/plate/classic/classic.h"
#include "tarsier/plate/networks/recognizer.h"
#include "tarsier/plate/text/decode.h"
#include "tarsier/plate/text/reading.h"

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::plate {

// The algorithms that find and read plates.
enum class Pipeline {
  kNetworks,  // networks/recognizer.h
  kTextbook   // classic/classic.h: edges, SVM, contours, one character at a time
};

struct ReaderOptions {
  Pipeline pipeline = Pipeline::kNetworks;
  // Codes ("es", "sk") or groups ("eu"). With "any" or an empty list, all known countries are
  // allowed, and also texts that fit no layout.
  std::vector<std::string> countries;
  double min_confidence = 0;  // of the whole text; plates below it are left out
  int max_candidates = 10;    // per plate

  // Files that replace the shipped models. An empty path selects the file of the ModelStore.
  std::string countries_folder;  // folder of layouts (*.txt)
  std::string detector_model;    // plate-detector.json; kTextbook: plate-svm.json
  std::string reader_model;      // plate-reader.json; kTextbook: plate-hog.json, plate-mlp.json

  // For kNetworks. RecognizerOptions::parallel changes the speed but never a result.
  RecognizerOptions recognizer;
  DecodeOptions decoding;  // `candidates` is raised to max_candidates if it is smaller

  // For kTextbook.
  ReaderKind textbook_reader = ReaderKind::kHog;
  ClassicOptions textbook;

  [[nodiscard]] OptionFields fields() {
    return {{"min_confidence", min_confidence, range(0, 1), "--min-confidence",
             "minimum confidence of a reported plate"},
            {"max_candidates", max_candidates, range(1, 100), "--top",
             "number of candidate texts for each plate"}};
  }
  void check() const;  // throws std::invalid_argument that names the value
};

// The plates of one frame.
struct ReaderResult {
  std::vector<Reading> plates;  // highest confidence first; empty if no plate is found
  double ms = 0;                // time spent in process(), milliseconds
};

// {"plates": [reading_json()..], "ms"}: a line of `tarsier plate read --json`, without the image
// name.
[[nodiscard]] nlohmann::ordered_json to_json(const ReaderResult& result);

// Finds and reads the number plates of single images:
//
//   const auto reader = plate::Reader::load(ModelStore::find());
//   const auto source = open_source("car.jpg");
//   while (const auto frame = source->next(1s, {}))
//     for (const plate::Reading& plate : reader.process(*frame).plates)
//       fmt::print("{} {:.2f}\n", plate.text, plate.confidence);
//
// The object holds the models and is const. Copies share the models, and any number of threads may
// use one object. VideoReader combines the frames of a video.
class Reader {
 public:
  // Reads the models and layouts. Throws ModelError (a missing or broken model), InputError (bad
  // layouts), UsageError (an unknown country; the message names the nearest known one) and
  // std::invalid_argument (bad options).
  [[nodiscard]] static Reader load(const ModelStore& models, const ReaderOptions& options = {});

  // `frame.image` is CV_8UC3 (BGR) or CV_8UC1. If `frame.still` is false, an uncertain plate is
  // read only once, because the next frame shows it again. `debug` receives the image of each
  // stage, and `timers` the duration of each stage (kNetworks: find, align, read). Both may be
  // null. `region` is the part of the image that is searched, px; if it is empty, the whole image
  // is searched. kTextbook always searches the whole image.
  [[nodiscard]] ReaderResult process(const Frame& frame, DebugSink* debug = nullptr,
                                     Timers* timers = nullptr, const cv::Rect& region = {}) const;

 private:
  using Read =
      std::function<std::vector<Reading>(const Frame&, DebugSink*, Timers*, const cv::Rect&)>;
  Reader(Read read, const ReaderOptions& options);

  Read read_;
  double min_confidence_;
  std::size_t max_candidates_;
};

// Loads only the networks of kNetworks, for callers that know the corners of the plates.
[[nodiscard]] Recognizer load_recognizer(const ModelStore& models,
                                         const ReaderOptions& options = {});

}  // namespace tarsier::plate
