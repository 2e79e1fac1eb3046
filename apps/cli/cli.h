// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/core/progress.h"

#include <CLI/CLI.hpp>

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
};

// Adds the flags that mean the same everywhere: --json, --quiet, --seed, --threads, --log-level,
// --progress, --config. -o/--output, --csv and --model are added by the verbs that have them.
void add_common_flags(CLI::App& verb, Context& context);

// --debug-dir, for verbs that can show the stages of what they do.
void add_debug_flag(CLI::App& verb, Context& context);

// One area each (cmd_<area>.cpp): adds its sub-commands; the chosen verb's callback sets
// context.run.
void add_cartoon(CLI::App& app, Context& context);
void add_plate(CLI::App& app, Context& context);
void add_landmarks(CLI::App& app, Context& context);
void add_aam(CLI::App& app, Context& context);
void add_pose(CLI::App& app, Context& context);
void add_people(CLI::App& app, Context& context);
void add_sfm(CLI::App& app, Context& context);
void add_calibrate(CLI::App& app, Context& context);
void add_ar(CLI::App& app, Context& context);
void add_models(CLI::App& app, Context& context);
void add_bench(CLI::App& app, Context& context);
void add_demo(CLI::App& app, Context& context);
void add_doctor(CLI::App& app, Context& context);
void add_help(CLI::App& app, Context& context);  // hidden from --help

// Runs the program: parses, runs the chosen verb, and turns every error into one line on stderr and
// an exit status. Never throws.
[[nodiscard]] int run_program(int argc, const char* const* argv);

// Writes one JSON object as a line to stdout and flushes. Throws OutputError when stdout is closed
// or full.
void print_json_line(const std::string& object);

// Writes text for people to stdout and flushes. Throws OutputError when stdout is closed or full.
void print_text(std::string_view text);

// "0.1.0"
[[nodiscard]] std::string_view version();

// `tarsier --help`
[[nodiscard]] std::string_view main_help();

// The folder of the running program, or an empty string where the system does not tell.
[[nodiscard]] std::string program_folder();

// The folder of the models that ship: `given` (--models-dir) if not empty, else $TARSIER_MODELS,
// else models/ of the source tree that this program was built in, else
// <prefix>/share/tarsier/models. Empty where none exists. Throws InputError when `given` or
// $TARSIER_MODELS is no folder.
[[nodiscard]] std::string find_models_folder(const std::string& given);

// What was probably meant by `word`: the nearest of `known`, or an empty string if none is near.
[[nodiscard]] std::string nearest_word(std::string_view word,
                                       const std::vector<std::string>& known);

}  // namespace tarsier::cli
