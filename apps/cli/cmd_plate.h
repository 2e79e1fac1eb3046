// SPDX-License-Identifier: MIT
#pragma once

#include "cli.h"

// One file a verb: cmd_plate_<verb>.cpp.
namespace tarsier::cli {

void add_plate_read(CLI::App& plate, Context& context);
void add_plate_segment(CLI::App& plate, Context& context);
void add_plate_train(CLI::App& plate, Context& context);  // train-detector, train-reader
void add_plate_eval(CLI::App& plate, Context& context);
void add_plate_sweep(CLI::App& plate, Context& context);
void add_plate_synth(CLI::App& plate, Context& context);
void add_plate_log(CLI::App& plate, Context& context);

}  // namespace tarsier::cli
