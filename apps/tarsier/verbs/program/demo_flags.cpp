// SPDX-License-Identifier: MIT
#include "verbs/program/demo_flags.h"

namespace tarsier::cli {
namespace {

void add_flags(Command& verb, DemoOptions& options) {
  verb.add_option("-o,--output", options.output, "folder of the page").show_default();
  verb.add_option("--only", options.only, "only these areas")
      .delimiter(',')
      .check(one_of({kDemoAreas.begin(), kDemoAreas.end()}));
}

}  // namespace

void add_demo(Command& app, Context& context, const RunDemo& run) {
  add_verb<DemoOptions>(app, "demo", "runs every area once and makes a page of it", context,
                        add_flags, run);
}

}  // namespace tarsier::cli
