// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"

namespace tarsier::cli {

// The verbs of `people`, one file each (<verb>.cpp).
void add_people_enroll(Command& area, Context& context);
void add_people_gallery(Command& area, Context& context);  // list, forget, export
void add_people_groups(Command& area, Context& context);   // group, groups, name
void add_people_correct(Command& area, Context& context);  // correct .., log
void add_people_index(Command& area, Context& context);
void add_people_train(Command& area, Context& context);
void add_people_identify(Command& area, Context& context);
void add_people_verify(Command& area, Context& context);
void add_people_show(Command& area, Context& context);
void add_people_eval(Command& area, Context& context);
void add_people_live(Command& area, Context& context);
void add_people_liveness(Command& area, Context& context);

}  // namespace tarsier::cli
