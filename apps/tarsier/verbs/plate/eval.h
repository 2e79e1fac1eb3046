// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame.h"
#include "tarsier/plate/text/evaluation.h"

#include "framework/cli.h"
#include <functional>

namespace tarsier::cli {

// Reads the plates of one image; `image` of the result is the frame's name.
using ImageReader = std::function<plate::ImageReadings(const Frame&)>;

// How `plate eval` reads images itself.
struct ImageReading {
  std::function<void(Command& verb)> add_flags;  // of its own (models, countries ..); may be empty
  std::function<ImageReader()> make;             // when the flags are known; throws as it must
};

// `plate eval`. With an empty `reading.make` it takes files of results only.
void add_plate_eval(Command& plate, Context& context, ImageReading reading);

}  // namespace tarsier::cli
