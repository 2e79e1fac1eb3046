// SPDX-License-Identifier: MIT
#include <fmt/format.h>

#include "framework/cli.h"
#include "framework/part_info.h"
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct BatchMergeFlags {
  std::vector<std::string> parts;
  std::string output;
};

ExitStatus run_merge(const BatchMergeFlags& flags, const Context& context) {
  const MergeReport report = merge_parts(flags.parts, flags.output);
  if (context.json) {
    print_json({{"output", flags.output},
                {"shards", report.shards},
                {"inputs", report.inputs},
                {"lines", report.lines},
                {"skipped", report.skipped}});
  } else if (!context.quiet) {
    print_text(fmt::format("{}: {} lines of {} images, from {} shards; {} could not be read\n",
                           flags.output, report.lines, report.inputs, report.shards,
                           report.skipped));
  }
  return report.lines > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

void add_flags(Command& verb, BatchMergeFlags& flags) {
  verb.add_option("PART", flags.parts, "files of --jsonl or --csv of all shards of one batch")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.output, "output file").required();
}

}  // namespace

void add_merge(Command& app, Context& context) {
  add_verb<BatchMergeFlags>(app, "merge",
                            "merge the files of all --shard runs into the file of a single run",
                            context, add_flags, run_merge);
}

}  // namespace tarsier::cli
