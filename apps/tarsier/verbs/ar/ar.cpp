// SPDX-License-Identifier: MIT
#include "verbs/ar/ar.h"

namespace tarsier::cli {

void add_ar(Command& app, Context& context) {
  Command& area = app.add_subcommand("ar", "printed markers, boards and images");
  area.require_subcommand(1);
  add_ar_eval(area, context);
  add_ar_marker_sheet(area, context);
  add_ar_markers(area, context);
  add_ar_synth(area, context);
  add_ar_target_track(area, context);
  add_ar_target_train(area, context);
}

}  // namespace tarsier::cli
