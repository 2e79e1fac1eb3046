// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/core/progress.h"

#include "framework/command.h"
#include "framework/exit_status.h"
#include "framework/output.h"
#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// What every verb shares. Filled by the parser, then completed by main before run() is called.
struct Context {
  std::vector<std::string> words;      // of the command line, without the program's name
  std::stop_token stop;                // SIGINT, SIGTERM
  std::function<ExitStatus()> run;     // set by the callback of the chosen verb
  std::unique_ptr<Progress> progress;  // as --progress and --quiet say

  bool json = false;  // JSON lines on stdout
  bool quiet = false;
  std::uint64_t seed = 1;
  int threads = 0;  // 0: all cores
  std::string log_level = "info";
  std::string progress_style = "auto";
  std::string debug_dir;

  bool is_batch = false;  // set by run(): a share of a batch, in which nothing has to be found
};

// Adds the flags that mean the same everywhere: --json, --quiet, --seed, --threads, --log-level,
// --progress, --config. -o/--output, --csv and --model are added by the verbs that have them.
void add_common_flags(Command& verb, Context& context);

// --debug-dir, for verbs that can show the stages of what they do.
void add_debug_flag(Command& verb, Context& context);

// Sets the example of every verb (examples.cpp).
void add_examples(Command& app);

// `run` is what the program does when `verb` was chosen.
void set_run(Command& verb, Context& context, std::function<ExitStatus()> run);

// Adds a verb: its flags are a `Flags` of its own, which `bind(verb, flags)` fills from the command
// line, and behind them the common ones; `run(flags, context)` does its work.
template <class Flags, class Bind, class Run>
Command& add_verb(Command& area, std::string_view name, std::string_view help, Context& context,
                  const Bind& bind, Run run) {
  Command& verb = area.add_subcommand(name, help);
  const auto flags = std::make_shared<Flags>();
  verb.add_flags_later([&verb, &context, flags, bind] {
    bind(verb, *flags);
    add_common_flags(verb, context);
  });
  set_run(verb, context, [flags, &context, run] { return run(*flags, context); });
  return verb;
}

// One area each (verbs/<area>/): adds its sub-commands; the chosen verb's callback sets
// context.run.
void add_cartoon(Command& app, Context& context);
void add_plate(Command& app, Context& context);
void add_landmarks(Command& app, Context& context);
void add_aam(Command& app, Context& context);
void add_pose(Command& app, Context& context);
void add_people(Command& app, Context& context);
void add_sfm(Command& app, Context& context);
void add_calibrate(Command& app, Context& context);
void add_ar(Command& app, Context& context);
void add_models(Command& app, Context& context);
void add_doctor(Command& app, Context& context);
void add_hub(Command& app, Context& context);
void add_merge(Command& app, Context& context);
void add_help(Command& app, Context& context);  // hidden from --help

// One of the programs that have this command line.
struct CommandLine {
  void (*add)(Command& root, Context& context);  // its areas, with their verbs and examples
  std::string_view help;                         // --help of the program itself
};

// Runs the program: parses, runs the chosen verb, and turns every error into one line on stderr and
// an exit status. Never throws.
[[nodiscard]] int run_program(const CommandLine& program, const std::vector<std::string>& words);
// What main() does: run_program() of words_of(argc, argv, area). Never throws, not even where there
// is no memory for the words.
[[nodiscard]] int run_main(const CommandLine& program, int argc, const char* const* argv,
                           std::string_view area = {});

// The words of a command line. Of a program of one area alone, that area's name comes first;
// `--version` alone stays as it is.
[[nodiscard]] std::vector<std::string> words_of(int argc, const char* const* argv,
                                                std::string_view area = {});

// "0.1.0"
[[nodiscard]] std::string_view version();

// The folder of the running program, or an empty string where the system does not tell.
[[nodiscard]] std::string program_folder();

// The folder of the models that ship: `given` (--models-dir) if not empty, else $TARSIER_MODELS,
// else models/ of the source tree that this program was built in, else
// <prefix>/share/tarsier/models. Empty where none exists. Throws InputError when `given` or
// $TARSIER_MODELS is no folder.
[[nodiscard]] std::string find_models_folder(const std::string& given);

}  // namespace tarsier::cli
