// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include "verbs/aam/engine.h"

// One file per verb: cmd_aam_<verb>.cpp.
namespace tarsier::cli {

void add_aam_train(Command& area, Context& context);
void add_aam_fit(Command& area, Context& context);
void add_aam_eval(Command& area, Context& context);
void add_aam_explore(Command& area, Context& context);

}  // namespace tarsier::cli
