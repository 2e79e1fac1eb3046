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

// State shared by all verbs. The parser fills it, then main completes it before it calls run().
struct Context {
  std::vector<std::string> words;      // command line without the program's name
  std::stop_token stop;                // SIGINT, SIGTERM
  std::function<ExitStatus()> run;     // set by the callback of the chosen verb
  std::unique_ptr<Progress> progress;  // according to --progress and --quiet

  bool json = false;  // JSON lines on stdout
  bool quiet = false;
  std::uint64_t seed = 1;
  int threads = 0;  // 0: all cores
  std::string log_level = "info";
  std::string progress_style = "auto";
  std::string debug_dir;

  // Set by run() for a share of a batch, where finding nothing is no failure.
  bool is_batch = false;
};

// Adds the flags that all verbs have: --json, --quiet, --seed, --threads, --log-level, --progress,
// --config. The verbs themselves add -o/--output, --csv and --model.
void add_common_flags(Command& verb, Context& context);

// Adds --debug-dir, for verbs that can show intermediate stages.
void add_debug_flag(Command& verb, Context& context);

// Sets the example of every verb (examples.cpp).
void add_examples(Command& app);

// Sets the function that runs if `verb` is chosen.
void set_run(Command& verb, Context& context, std::function<ExitStatus()> run);

// Adds a verb. `bind(verb, flags)` binds the members of a `Flags` object to flags of the command
// line; the common flags follow. `run(flags, context)` does the work. The default of `Bind` selects
// the overload for `Flags` if `bind` names an overloaded function.
template <class Flags, class Bind = void (*)(Command&, Flags&), class Run>
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

// One function per area (verbs/<area>/): it adds the area's verbs. The callback of the chosen verb
// sets context.run.
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

// Describes a program with this command line.
struct CommandLine {
  void (*add)(Command& root, Context& context);  // adds its areas, with verbs and examples
  std::string_view help;                         // --help of the program itself
};

// Runs the program: parses, runs the chosen verb, and turns every error into one line on stderr and
// an exit status. Never throws.
[[nodiscard]] int run_program(const CommandLine& program, const std::vector<std::string>& words);
// The body of main(): run_program() with words_of(argc, argv, area). Never throws, not even if
// there is no memory for the words.
[[nodiscard]] int run_main(const CommandLine& program, int argc, const char* const* argv,
                           std::string_view area = {});

// The words of a command line. For a program with a single area, that area's name is inserted
// first; `--version` alone is unchanged.
[[nodiscard]] std::vector<std::string> words_of(int argc, const char* const* argv,
                                                std::string_view area = {});

// "0.1.0"
[[nodiscard]] std::string_view version();

// The folder of the running program; empty if the system does not report it.
[[nodiscard]] std::string program_folder();

// The folder of the shipped models, by the rules of ModelStore::find(): `given` if not empty, else
// $TARSIER_MODELS, else the folder that comes with the program. Empty if there is none. Throws
// InputError if `given` or $TARSIER_MODELS is not a folder.
[[nodiscard]] std::string find_models_folder(const std::string& given);

}  // namespace tarsier::cli
