// SPDX-License-Identifier: MIT
#pragma once

#include "cli.h"

namespace tarsier::cli {

// The verbs of `people`, one file each (cmd_people_<verb>.cpp).
void add_people_enroll(CLI::App& area, Context& context);
void add_people_gallery(CLI::App& area, Context& context);  // list, forget, export
void add_people_train(CLI::App& area, Context& context);
void add_people_identify(CLI::App& area, Context& context);
void add_people_verify(CLI::App& area, Context& context);
void add_people_show(CLI::App& area, Context& context);
void add_people_eval(CLI::App& area, Context& context);
void add_people_live(CLI::App& area, Context& context);

}  // namespace tarsier::cli
