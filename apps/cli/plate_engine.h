// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/io/frame.h"
#include "tarsier/plate/recognizer.h"
#include "tarsier/plate_classic/classic.h"

#include <opencv2/core/mat.hpp>

#include "cli.h"
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace tarsier::cli {

// The flags of every verb that reads plates, and the reader they describe.
struct PlateFlags {
  std::string pipeline = "default";
  std::vector<std::string> countries;
  std::string countries_folder;
  std::string detector;  // model files; empty: what ships
  std::string reader;
  std::string classic_reader = "hog";
  plate::RecognizerOptions recognizer;
  plate::DecodeOptions decoding;
  double least_confidence = 0;
  int top = 10;
};

void add_plate_flags(Command& verb, PlateFlags& flags);

// Of a frame of a film each plate is looked at once; a still has no second frame.
using PlateReader =
    std::function<std::vector<plate::Reading>(const Frame& frame, DebugSink* debug)>;

// The default pipeline alone. Throws ModelError, UsageError.
[[nodiscard]] std::shared_ptr<const plate::Recognizer> make_recognizer(const PlateFlags& flags,
                                                                       const Context& context);

// Reads models and countries. Throws ModelError, UsageError.
[[nodiscard]] PlateReader make_plate_reader(const PlateFlags& flags, const Context& context);

}  // namespace tarsier::cli
