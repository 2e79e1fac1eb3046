// SPDX-License-Identifier: MIT
#include "verbs/program/bench_flags.h"

#include <memory>

namespace tarsier::cli {

void add_bench(Command& app, Context& context, const RunBench& run) {
  Command& bench = app.add_subcommand("bench", "measure speed on this machine");
  bench.require_subcommand(1);
  const auto options = std::make_shared<BenchOptions>();
  for (const BenchInfo& info : kBenches) {
    Command& verb = bench.add_subcommand(info.name, info.help);
    verb.add_option("INPUT", options->inputs, "images to measure on [the benchmark's own]");
    verb.add_option("--repeats", options->repeats,
                    "runs per case, after one to warm up; the median is reported")
        .check(range(1, 100000))
        .show_default();
    verb.add_option("--size", options->sizes, "only these sizes: 640x480").delimiter(',');
    verb.add_option("--only", options->only, "only these cases: sketch,paint").delimiter(',');
    if (info.name == "cartoon") {
      verb.add_flag("--stages", options->stages, "print the time of each stage");
    }
    add_common_flags(verb, context);
    set_run(verb, context,
            [&context, options, run, name = info.name] { return run(name, *options, context); });
  }
}

}  // namespace tarsier::cli
