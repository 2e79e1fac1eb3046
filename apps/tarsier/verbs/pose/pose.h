// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include "verbs/pose/engine.h"

// One file per verb: cmd_pose_<verb>.cpp.
namespace tarsier::cli {

void add_pose_solve(Command& area, Context& context);
void add_pose_train_head(Command& area, Context& context);
void add_pose_train_view(Command& area, Context& context);
void add_pose_track(Command& area, Context& context);
void add_pose_eval(Command& area, Context& context);
void add_pose_synth(Command& area, Context& context);

}  // namespace tarsier::cli
