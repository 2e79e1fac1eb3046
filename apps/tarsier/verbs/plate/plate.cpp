// SPDX-License-Identifier: MIT
#include "verbs/plate/plate.h"

#include "verbs/plate/engine.h"
#include "verbs/plate/eval.h"
#include <memory>
#include <utility>

namespace tarsier::cli {
namespace {

// `plate eval` reads images with the same flags as `plate read`.
ImageReading image_reading(Context& context) {
  auto flags = std::make_shared<PlateFlags>();
  ImageReading reading;
  reading.add_flags = [flags](Command& verb) { add_plate_flags(verb, *flags); };
  reading.make = [flags, &context] {
    return [reader = load_reader(*flags, context)](const Frame& frame) {
      plate::ReaderResult result = reader.process(frame);
      plate::ImageReadings readings;
      readings.image = frame.name;
      readings.plates = std::move(result.plates);
      readings.milliseconds = result.ms;
      return readings;
    };
  };
  return reading;
}

}  // namespace

void add_plate(Command& app, Context& context) {
  Command& plate = app.add_subcommand("plate", "number plates: find, read, train, evaluate");
  plate.require_subcommand(1);
  add_plate_read(plate, context);
  add_plate_segment(plate, context);
  add_plate_train(plate, context);
  add_plate_eval(plate, context, image_reading(context));
  add_plate_sweep(plate, context);
  add_plate_synth(plate, context);
  add_plate_log(plate, context);
  add_plate_watch(plate, context);
}

}  // namespace tarsier::cli
