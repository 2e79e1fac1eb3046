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

// By which algorithms plates are found and read.
enum class Pipeline {
  kNetworks,  // networks/recognizer.h
  kTextbook   // classic/classic.h: edges, SVM, contours, one character at a time
};

struct ReaderOptions {
  Pipeline pipeline = Pipeline::kNetworks;
  // Codes ("es", "sk") or groups ("eu"); "any" or none: all that are known, and texts of no layout.
  std::vector<std::string> countries;
  double min_confidence = 0;  // of the whole text; plates below are left out
  int max_candidates = 10;    // of each plate

  // Files in place of the models that ship; empty: those of the ModelStore.
  std::string countries_folder;  // of layouts (*.txt)
  std::string detector_model;    // plate-detector.json; of the textbook plate-svm.json
  std::string reader_model;  // plate-reader.json; of the textbook plate-hog.json, plate-mlp.json

  // Of kNetworks. RecognizerOptions::parallel changes the speed, never a result.
  RecognizerOptions recognizer;
  DecodeOptions decoding;  // `candidates` is raised to max_candidates where it is less

  // Of kTextbook.
  ReaderKind textbook_reader = ReaderKind::kHog;
  ClassicOptions textbook;

  [[nodiscard]] OptionFields fields() {
    return {{"min_confidence", min_confidence, range(0, 1), "--min-confidence",
             "leave out plates below"},
            {"max_candidates", max_candidates, range(1, 100), "--top", "candidates of each plate"}};
  }
  void check() const;  // throws std::invalid_argument that names the value
};

// What is read in one frame.
struct ReaderResult {
  std::vector<Reading> plates;  // surest first; empty where there are none
  double ms = 0;                // spent in process(), milliseconds
};

// {"plates": [reading_json()..], "ms"}: the line of `tarsier plate read --json` without the image's
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
// Holds the models, and is const: copies share them, any number of threads may use it. What belongs
// together in a video is VideoReader's.
class Reader {
 public:
  // Reads the models and layouts. Throws ModelError (missing or broken), InputError (layouts),
  // UsageError (an unknown country, naming the nearest), std::invalid_argument (options).
  [[nodiscard]] static Reader load(const ModelStore& models, const ReaderOptions& options = {});

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. Where `frame.still` is false a plate that is not sure
  // is looked at only once, as the next frame is another look. `debug` takes each stage; `timers`
  // (of kNetworks: find, align, read) what each took; both may be null. `where`: the part of the image
  // in which plates are looked for, px; empty: all of it. kTextbook looks everywhere.
  [[nodiscard]] ReaderResult process(const Frame& frame, DebugSink* debug = nullptr,
                                     Timers* timers = nullptr, const cv::Rect& where = {}) const;

 private:
  using Read =
      std::function<std::vector<Reading>(const Frame&, DebugSink*, Timers*, const cv::Rect&)>;
  Reader(Read read, const ReaderOptions& options);

  Read read_;
  double min_confidence_;
  std::size_t max_candidates_;
};

// The networks of kNetworks alone, for those who read plates whose corners are known.
[[nodiscard]] Recognizer load_recognizer(const ModelStore& models,
                                         const ReaderOptions& options = {});

}  // namespace tarsier::plate
