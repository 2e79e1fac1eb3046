// SPDX-License-Identifier: MIT
#include "verbs/people/people.h"

namespace tarsier::cli {

void add_people(Command& app, Context& context) {
  Command& area = app.add_subcommand(
      "people", "recognise people: enroll, identify, verify, group, correct, forget, evaluate");
  area.require_subcommand(1);
  add_people_enroll(area, context);
  add_people_gallery(area, context);
  add_people_groups(area, context);
  add_people_correct(area, context);
  add_people_train(area, context);
  add_people_index(area, context);
  add_people_identify(area, context);
  add_people_verify(area, context);
  add_people_show(area, context);
  add_people_eval(area, context);
  add_people_live(area, context);
  add_people_liveness(area, context);
}

}  // namespace tarsier::cli
