// SPDX-License-Identifier: MIT
#include "framework/cli.h"

#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/model_store.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

#include "framework/command_tree.h"
#include "framework/error_help.h"
#include "framework/option_names.h"
#include "framework/parse.h"
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <new>
#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace tarsier::cli {
namespace {

std::string one_line(std::string_view text) {
  std::string result;
  for (const char c : text) {
    if (c != '\n' && c != '\r' && c != '\t') {
      result += c;
    } else if (!result.empty() && result.back() != ' ') {
      result += ' ';
    }
  }
  while (!result.empty() && result.back() == ' ') result.pop_back();
  return printable(result);
}

int fail(ExitStatus status, std::string_view message) {
  const std::string line = fmt::format("tarsier: error: {}\n", one_line(message));
  std::fwrite(line.data(), 1, line.size(), stderr);
  std::fflush(stderr);
  return static_cast<int>(status);
}

// TARSIER_REQUIRE writes "<function>: requires <expression>: <message>". Returns the message and
// the text before the function (the path of a file).
std::string without_requirement(std::string_view what) {
  constexpr std::string_view kRequirementMark = ": requires ";
  const size_t mark = what.find(kRequirementMark);
  if (mark == std::string_view::npos) return std::string(what);
  const size_t before = mark == 0 ? std::string_view::npos : what.rfind(": ", mark - 1);
  const std::string_view prefix =
      before == std::string_view::npos ? std::string_view() : what.substr(0, before + 2);
  for (size_t at = what.find(": ", mark + kRequirementMark.size()); at != std::string_view::npos;
       at = what.find(": ", at + 1)) {
    if (what[at - 1] != ' ') {  // not the ':' of "a ? b : c"
      return fmt::format("{}{}", prefix, what.substr(at + 2));
    }
  }
  return std::string(what);
}

// --- the program ---

// The libraries below write to stderr themselves; relevant errors are returned to us and reported.
void silence_libraries() {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
  unsetenv("OPENCV_VIDEOIO_DEBUG");
  unsetenv("OPENCV_FFMPEG_DEBUG");
  setenv("QT_LOGGING_RULES", "*.debug=false;*.info=false;*.warning=false;qt.*=false", 0);
}

// Each frame allocates and frees images of megabytes. Freed memory is kept for the next one instead
// of being returned to the system, which must clear every page that it gives.
void keep_freed_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 32 << 20);   // bytes; the maximum
  mallopt(M_TRIM_THRESHOLD, 128 << 20);  // bytes kept at most
#endif
}

void apply_common_flags(Context& context) {
  const LogLevel level = parse_log_level(context.log_level);
  set_log_level(context.quiet ? std::max(level, LogLevel::kWarning) : level);
  context.progress = make_progress(
      context.quiet ? ProgressStyle::kNone : parse_progress_style(context.progress_style), stderr);
  // 0 would mean "none" to OpenCV; with more threads than cores its scheduler only complains on
  // stderr.
  if (context.threads > 0) cv::setNumThreads(std::min(context.threads, cv::getNumberOfCPUs()));
}

// All flag names of a verb: "--ca-file", "-o" ..
std::vector<std::string> flag_names(const Command& verb) {
  std::vector<std::string> names;
  for (const FlagInfo& flag : verb.flags())
    names.insert(names.end(), flag.names.begin(), flag.names.end());
  return names;
}

// `flags` receives the flag names of the verb that threw the error.
int parse_and_run(const CommandLine& program, const std::vector<std::string>& words,
                  std::vector<std::string>& flags) {
  Context context;
  context.words = words;
  context.stop = stop_on_signals();
  // A closed pipe and a file size limit become errors of write(), which are reported.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  silence_libraries();
  keep_freed_memory();

  Command app("tarsier", "classical computer vision on an ordinary CPU, offline");
  program.add(app, context);

  const CommandMatch match = match_command(app, words);
  const auto help_of = [&](const Command& command) {
    return &command == &app ? std::string(program.help) : help_text(command);
  };
  if (is_area(*match.command) && match.word_count == words.size()) {
    const std::string help = help_of(*match.command);
    std::fwrite(help.data(), 1, help.size(), stderr);
    return static_cast<int>(ExitStatus::kUsage);
  }
  const Command::Parsed parsed = parse_command_line(app, words);
  if (parsed.outcome == Command::Outcome::kHelp) {
    print_text(help_of(*parsed.command));
    return 0;
  }
  if (parsed.outcome == Command::Outcome::kVersion) {
    print_text(fmt::format("tarsier {}\n", version()));
    return 0;
  }
  apply_common_flags(context);
  ExitStatus status = ExitStatus::kDone;
  try {
    status = context.run();
  } catch (...) {
    flags = flag_names(*parsed.command);
    throw;
  }
  if (context.is_batch && status == ExitStatus::kNothingFound) status = ExitStatus::kDone;
  context.progress.reset();
  print_text("");  // detects a full disk or a closed pipe at stdout
  return static_cast<int>(status);
}

}  // namespace

void add_common_flags(Command& verb, Context& context) {
  const auto common = [](Flag& flag) { flag.group("Common"); };
  verb.add_version_flag("--version").group("");
  common(verb.add_flag("--json", context.json, "write JSON lines to stdout, logs to stderr"));
  common(verb.add_flag("--quiet", context.quiet, "log only warnings and errors"));
  common(verb.add_option("--seed", context.seed, "seed of all random numbers")
             .check(Check([](const std::string& text) {
               return text.starts_with("-") ? "a seed is not negative" : std::string();
             }))
             .show_default());
  common(verb.add_option("--threads", context.threads, "number of threads; 0: all cores")
             .check(range(0, 1024))
             .show_default());
  common(verb.add_option("--log-level", context.log_level)
             .check(one_of({"debug", "info", "warning", "error", "off"}))
             .show_default());
  common(verb.add_option("--progress", context.progress_style, "progress display")
             .check(one_of({"auto", "bar", "json", "none"}))
             .show_default());
  // It is read before the parser runs (parse_command_line). It is declared here for the parser and
  // --help.
  common(verb.add_unbound_option("--config", "TOML or INI file with values of these flags")
             .type_name("FILE"));
}

void add_debug_flag(Command& verb, Context& context) {
  verb.add_option("--debug-dir", context.debug_dir, "output folder for the images of each stage")
      .group("Output");
}

void set_run(Command& verb, Context& context, std::function<ExitStatus()> run) {
  verb.callback([&context, run = std::move(run)] { context.run = run; });
}

int run_program(const CommandLine& program, const std::vector<std::string>& words) {
  std::vector<std::string> flags;
  const auto message_of = [&flags](const std::exception& error) {
    return with_flag_names(without_requirement(error.what()), flags) + error_help(error);
  };
  try {
    return parse_and_run(program, words, flags);
  } catch (const Error& error) {
    return fail(exit_status(error.kind()), message_of(error));
  } catch (const std::invalid_argument& error) {
    return fail(ExitStatus::kUsage, message_of(error));
  } catch (const cv::Exception& error) {
    return fail(ExitStatus::kBadInput,
                fmt::format("OpenCV cannot do this: {} ({})", error.err, error.func));
  } catch (const std::bad_alloc&) {
    return fail(ExitStatus::kBadInput, "out of memory: the input is too large for this machine");
  } catch (const std::exception& error) {
    return fail(ExitStatus::kBadInput, error.what());
  }
}

int run_main(const CommandLine& program, int argc, const char* const* argv, std::string_view area) {
  try {
    return run_program(program, words_of(argc, argv, area));
  } catch (const std::bad_alloc&) {  // nothing here may allocate memory
    constexpr std::string_view kLine = "tarsier: error: out of memory\n";
    std::fwrite(kLine.data(), 1, kLine.size(), stderr);
    return static_cast<int>(ExitStatus::kBadInput);
  }
}

std::string_view version() { return TARSIER_VERSION; }

std::vector<std::string> words_of(int argc, const char* const* argv, std::string_view area) {
  std::vector<std::string> words(argv + std::min(argc, 1), argv + argc);
  if (!area.empty() && words != std::vector<std::string>{"--version"})
    words.insert(words.begin(), std::string(area));
  return words;
}

std::string program_folder() { return tarsier::program_folder(); }

std::string find_models_folder(const std::string& given) {
  return ModelStore::find(given).folder();
}

}  // namespace tarsier::cli
