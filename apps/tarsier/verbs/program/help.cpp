// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "framework/areas.h"
#include "framework/cli.h"
#include "framework/command_json.h"
#include "framework/command_tree.h"
#include "framework/manual.h"
#include "framework/parse.h"
#include <cstdlib>
#include <ctime>

namespace tarsier::cli {
namespace {

struct HelpOptions {
  std::vector<std::string> words;
  std::string manual;
  bool bash = false;
};

// The build date. $SOURCE_DATE_EPOCH may fix it, so that the same source gives the same files.
std::string date_of_build() {
  std::time_t now = std::time(nullptr);
  if (const char* fixed = std::getenv("SOURCE_DATE_EPOCH"); fixed != nullptr) {
    now = static_cast<std::time_t>(std::strtoll(fixed, nullptr, 10));
  }
  return fmt::format("{:%Y-%m-%d}", fmt::gmtime(now));
}

const Command& command_of(const Command& root, const std::vector<std::string>& words) {
  const Command* command = &root;
  for (const std::string& word : words) {
    const Command* next = command->find(word);
    if (next == nullptr) {
      std::vector<std::string> known;
      for (const Command* part : command->subcommands()) known.push_back(part->name());
      const std::string meant = nearest_word(word, known);
      throw UsageError(fmt::format("no help for '{}'{}", word,
                                   meant.empty() ? "" : ": did you mean '" + meant + "'?"));
    }
    command = next;
  }
  return *command;
}

ExitStatus run_help(const Command& root, const Context& context, const HelpOptions& options) {
  if (!options.manual.empty()) {
    make_folder(options.manual);
    for (const ManualFile& page : manual_pages(command_tree(root), date_of_build())) {
      write_file_atomically(options.manual + '/' + page.name, page.text);
    }
  } else if (options.bash) {
    print_text(bash_completion(command_tree(root)));
  } else if (context.json) {
    print_text(command_json(command_tree(root), version()) + '\n');
  } else {
    print_text(options.words.empty() ? std::string(main_help())
                                     : help_text(command_of(root, options.words)));
  }
  return ExitStatus::kDone;
}

}  // namespace

void add_help(Command& app, Context& context) {
  Command& verb = app.add_subcommand(
      "help", "show the help of a verb, or describe all verbs for other programs");
  verb.group("");  // hidden: messages refer to `--help` after a verb
  const auto options = std::make_shared<HelpOptions>();
  verb.add_option("VERB", options->words, "area and verb: plate read");
  Flag& manual = verb.add_option("--man", options->manual, "output folder for manual pages");
  verb.add_flag("--bash", options->bash, "write a completion script for bash to stdout")
      .excludes(manual);
  add_common_flags(verb, context);
  set_run(verb, context, [&app, &context, options] { return run_help(app, context, *options); });
}

}  // namespace tarsier::cli
