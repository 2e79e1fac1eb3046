// SPDX-License-Identifier: MIT
#include "verbs/program/demo_flags.h"

namespace tarsier::cli {
namespace {

void add_flags(Command& verb, DemoOptions& options) {
  verb.add_option("-o,--output", options.output, "output folder of the page").show_default();
  verb.add_option("--only", options.only, "run only these areas")
      .delimiter(',')
      .check(one_of({kDemoAreas.begin(), kDemoAreas.end()}));
}

}  // namespace

void add_demo(Command& app, Context& context, const RunDemo& run) {
  add_verb<DemoOptions>(app, "demo", "run every area once and write a page of the results", context,
                        add_flags, run);
}

}  // namespace tarsier::cli
