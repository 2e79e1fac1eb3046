// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"

// One file per verb: cmd_plate_<verb>.cpp.
namespace tarsier::cli {

void add_plate_read(Command& plate, Context& context);
void add_plate_segment(Command& plate, Context& context);
void add_plate_train(Command& plate, Context& context);  // train-detector, train-reader
void add_plate_eval(Command& plate, Context& context);
void add_plate_sweep(Command& plate, Context& context);
void add_plate_synth(Command& plate, Context& context);
void add_plate_log(Command& plate, Context& context);
void add_plate_watch(Command& plate, Context& context);  // add, remove, list, test

}  // namespace tarsier::cli
