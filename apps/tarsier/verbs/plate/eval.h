// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame.h"
#include "tarsier/plate/text/evaluation.h"

#include "framework/cli.h"
#include <functional>

namespace tarsier::cli {

// Reads the plates of one image; `image` of the result is the frame's name.
using ImageReader = std::function<plate::ImageReadings(const Frame&)>;

// How `plate eval` reads images.
struct ImageReading {
  // adds own flags (models, countries ..); may be empty
  std::function<void(Command& verb)> add_flags;
  std::function<ImageReader()> make;  // called after parsing; may throw
};

// Adds `plate eval`. If `reading.make` is empty, the verb accepts only files of results.
void add_plate_eval(Command& plate, Context& context, ImageReading reading);

}  // namespace tarsier::cli
