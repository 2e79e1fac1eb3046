// SPDX-License-Identifier: MIT
#pragma once

#include "cli.h"

// One file a verb: cmd_ar_<verb>.cpp.
namespace tarsier::cli {

void add_ar_eval(CLI::App& ar, Context& context);
void add_ar_marker_sheet(CLI::App& ar, Context& context);
void add_ar_markers(CLI::App& ar, Context& context);
void add_ar_synth(CLI::App& ar, Context& context);
void add_ar_target_track(CLI::App& ar, Context& context);
void add_ar_target_train(CLI::App& ar, Context& context);

}  // namespace tarsier::cli
