// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"

// One file per verb: cmd_ar_<verb>.cpp.
namespace tarsier::cli {

void add_ar_eval(Command& ar, Context& context);
void add_ar_marker_sheet(Command& ar, Context& context);
void add_ar_markers(Command& ar, Context& context);
void add_ar_synth(Command& ar, Context& context);
void add_ar_target_track(Command& ar, Context& context);
void add_ar_target_train(Command& ar, Context& context);

}  // namespace tarsier::cli
