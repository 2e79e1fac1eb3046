// SPDX-License-Identifier: MIT
#include "verbs/aam/aam.h"

namespace tarsier::cli {

void add_aam(Command& app, Context& context) {
  Command& area = app.add_subcommand(
      "aam", "appearance models of faces and other objects: train, explore, fit");
  area.require_subcommand(1);
  add_aam_train(area, context);
  add_aam_explore(area, context);
  add_aam_fit(area, context);
  add_aam_eval(area, context);
}

}  // namespace tarsier::cli
