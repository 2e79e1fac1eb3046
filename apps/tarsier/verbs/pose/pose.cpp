// SPDX-License-Identifier: MIT
#include "verbs/pose/pose.h"

namespace tarsier::cli {

void add_pose(Command& app, Context& context) {
  Command& area = app.add_subcommand("pose", "head poses, and poses of objects with known points");
  area.require_subcommand(1);
  add_pose_solve(area, context);
  add_pose_train_head(area, context);
  add_pose_train_view(area, context);
  add_pose_track(area, context);
  add_pose_eval(area, context);
  add_pose_synth(area, context);
}

}  // namespace tarsier::cli
