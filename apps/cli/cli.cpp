// SPDX-License-Identifier: MIT
#include "cli.h"

#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/image_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

#include "command_tree.h"
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <new>
#include <numeric>
#include <sstream>
#include <system_error>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kHelp = R"(tarsier - classical computer vision on an ordinary CPU, offline

  tarsier <area> <verb> [inputs] [flags]

See what it does, then use your own pictures, then your camera:

  tarsier demo                                   a page of pictures: demo-out/index.html
  tarsier cartoon run photo.jpg -o drawn.png     a photograph becomes a cartoon
  tarsier landmarks track 0 --window             68 points of each face, live
  tarsier pose track 0 --window --draw glasses   where heads look, live
  tarsier plate read car.jpg                     a number plate
  tarsier sfm reconstruct photos/ -o model       cameras and a cloud of points

Areas:
  cartoon run              cartoons of pictures, films and live cameras
  landmarks fit|track|..   points of faces: annotate, train, fit, follow, judge
  aam explore|fit|..       appearance models: train, play with, fit
  pose track|solve|..      where heads look; the pose of a known object; a head in 3D
  people enroll|live|..    who is it, or unknown: enrol, identify, forget, judge
  plate read|train-..|..   number plates: read, train, judge, log
  sfm reconstruct|eval|..  photographs to camera poses and a point cloud
  calibrate                a camera's lens from pictures of a printed board
  ar marker-sheet|..       printed markers: sheets of them, and boards for calibrate
  models list|info|verify  the trained models that came with the program
  doctor                   what this machine has, and what to do about what it lacks
  demo                     runs every area once and makes a page of it
  bench NAME               how fast it is here

An input is a picture, a folder, a glob, @list.txt, a film, a camera number or a URL.
Everywhere: -o OUT, --json, --quiet, --threads N, --config FILE; `--help` after any verb.
Exit status: 0 done, 1 nothing found, 2 usage, 3 bad input, 4 source lost, 5 bad model,
6 cannot write, 130 interrupted. `tarsier --version` tells the version.
)";

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

// TARSIER_REQUIRE writes "<function>: requires <expression>: <message>"; people want the message,
// and what was said before it (the path of a file).
std::string without_requirement(std::string_view what) {
  constexpr std::string_view kMark = ": requires ";
  const size_t mark = what.find(kMark);
  if (mark == std::string_view::npos) return std::string(what);
  const size_t before = mark == 0 ? std::string_view::npos : what.rfind(": ", mark - 1);
  const std::string_view prefix =
      before == std::string_view::npos ? std::string_view() : what.substr(0, before + 2);
  for (size_t at = what.find(": ", mark + kMark.size()); at != std::string_view::npos;
       at = what.find(": ", at + 1)) {
    if (what[at - 1] != ' ') {  // not the ':' of "a ? b : c"
      return fmt::format("{}{}", prefix, what.substr(at + 2));
    }
  }
  return std::string(what);
}

// --- the chosen verb ---

std::vector<std::string> verb_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* sub :
       app.get_subcommands([](const CLI::App* s) { return !s->get_name().empty(); })) {
    names.push_back(sub->get_name());
  }
  return names;
}

bool is_area(const CLI::App& app) { return !verb_names(app).empty(); }

std::string path_of(const CLI::App& app) {
  const std::string verb = verb_of(app);
  return verb.empty() ? "tarsier" : "tarsier " + verb;
}

// The words that lead to a verb, as `tokens` has them; `count` tells how many were used.
CLI::App* chosen_app(CLI::App& root, const std::vector<std::string>& tokens, size_t& count) {
  CLI::App* app = &root;
  for (count = 0; count < tokens.size(); ++count) {
    CLI::App* next = nullptr;
    for (CLI::App* sub : app->get_subcommands([](CLI::App*) { return true; })) {
      if (sub->get_name() == tokens[count]) next = sub;
    }
    if (next == nullptr) break;
    app = next;
  }
  return app;
}

std::string join(const std::vector<std::string>& words) {
  std::string result;
  for (const std::string& word : words) result += (result.empty() ? "" : ", ") + word;
  return result;
}

std::vector<std::string> flag_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

// Words that stand where an area, a verb or a flag is expected and are none: says what is known
// there.
void check_words(CLI::App& root, const std::vector<std::string>& tokens) {
  size_t count = 0;
  const CLI::App* app = chosen_app(root, tokens, count);
  if (count == tokens.size()) return;
  const std::string& word = tokens[count];
  if (is_area(*app)) {
    if (word == "-h" || word == "--help" || (word == "--version" && app == &root)) return;
    if (word.starts_with("-") && app == &root) {
      throw UsageError(
          fmt::format("unknown flag {} here: flags come after the verb (tarsier --help)", word));
    }
    const std::vector<std::string> known = verb_names(*app);
    const std::string meant = nearest_word(word, known);
    throw UsageError(
        fmt::format("'{}' knows no '{}': {}", path_of(*app), word,
                    meant.empty() ? "known: " + join(known) : "did you mean '" + meant + "'?"));
  }
  for (size_t i = count; i < tokens.size() && tokens[i] != "--"; ++i) {
    if (!tokens[i].starts_with("--")) continue;
    const std::string flag = tokens[i].substr(0, tokens[i].find('='));
    const std::vector<std::string> known = flag_names(*app);
    if (std::find(known.begin(), known.end(), flag) != known.end()) continue;
    const std::string meant = nearest_word(flag, known);
    throw UsageError(fmt::format(
        "'{}' has no flag {}: {}", path_of(*app), flag,
        meant.empty() ? "see " + path_of(*app) + " --help" : "did you mean " + meant + "?"));
  }
}

// --- --config ---

bool given_on_line(const CLI::Option& option, const std::vector<std::string>& tokens, size_t from) {
  for (size_t i = from; i < tokens.size() && tokens[i] != "--"; ++i) {
    const std::string& token = tokens[i];
    for (const std::string& name : option.get_lnames()) {
      if (token == "--" + name || token.starts_with("--" + name + "=")) return true;
    }
    for (const std::string& name : option.get_snames()) {
      if (token.starts_with("-" + name) && !token.starts_with("--")) return true;
    }
  }
  return false;
}

void add_item(const CLI::App& verb, const CLI::ConfigItem& item, const std::string& path,
              const std::vector<std::string>& tokens, size_t from,
              std::vector<std::string>& added) {
  const CLI::Option* option = verb.get_option_no_throw("--" + item.name);
  if (option == nullptr || item.name == "config" || item.name == "help") {
    const std::string meant = nearest_word("--" + item.name, flag_names(verb));
    throw UsageError(fmt::format("{}: '{}' has no option '{}'{}", path, path_of(verb), item.name,
                                 meant.empty() ? "" : ": did you mean '" + meant.substr(2) + "'?"));
  }
  if (given_on_line(*option, tokens, from)) return;  // the command line wins
  if (item.inputs.empty()) throw UsageError(fmt::format("{}: '{}' has no value", path, item.name));
  if (item.inputs.size() == 1 || option->get_items_expected_max() == 1) {  // a list as "60,25,20"
    added.push_back(fmt::format("--{}={}", item.name, fmt::join(item.inputs, ",")));
  } else {
    added.push_back("--" + item.name);
    added.insert(added.end(), item.inputs.begin(), item.inputs.end());
  }
}

// Turns the file of --config into flags behind those of the command line. Top-level keys are the
// chosen verb's; a section [area.verb] holds those of one verb, so that one file can serve several.
std::vector<std::string> with_config(CLI::App& root, std::vector<std::string> tokens) {
  size_t from = 0;
  const CLI::App* verb = chosen_app(root, tokens, from);
  std::string path;
  const size_t end =
      static_cast<size_t>(std::find(tokens.begin(), tokens.end(), "--") - tokens.begin());
  for (size_t i = from; i < end; ++i) {
    if (tokens[i] == "--config" && i + 1 < end) path = tokens[i + 1];
    if (tokens[i].starts_with("--config=")) path = tokens[i].substr(9);
  }
  if (path.empty() || is_area(*verb)) return tokens;

  std::istringstream text(read_file(path, 1'000'000));
  std::vector<CLI::ConfigItem> items;
  try {
    items = CLI::ConfigTOML().from_config(text);
  } catch (const std::exception& error) {
    throw InputError(path, fmt::format("not a TOML or INI file: {}", error.what()));
  }
  std::vector<std::string> added;
  for (const CLI::ConfigItem& item : items) {
    if (item.name == "++" || item.name == "--") continue;  // marks of a section's begin and end
    if (!item.parents.empty()) {
      size_t used = 0;
      const CLI::App* section = chosen_app(root, item.parents, used);
      if (used < item.parents.size() || is_area(*section)) {
        throw UsageError(fmt::format("{}: [{}] is no area and verb", path, item.fullname()));
      }
      if (section != verb) continue;
    }
    add_item(*verb, item, path, tokens, from, added);
  }
  tokens.insert(tokens.begin() + static_cast<std::ptrdiff_t>(end), added.begin(), added.end());
  return tokens;
}

// --- the program ---

// The libraries below us write to stderr on their own; what matters comes back as an error of ours.
void silence_libraries() {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
  unsetenv("OPENCV_VIDEOIO_DEBUG");
  unsetenv("OPENCV_FFMPEG_DEBUG");
  setenv("QT_LOGGING_RULES", "*.debug=false;*.info=false;*.warning=false;qt.*=false", 0);
}

void complete(Context& context) {
  const LogLevel level = parse_log_level(context.log_level);
  set_log_level(context.quiet ? std::max(level, LogLevel::kWarning) : level);
  context.progress = make_progress(
      context.quiet ? ProgressStyle::kNone : parse_progress_style(context.progress_style), stderr);
  // 0 would mean "none" to OpenCV; more threads than cores only make its scheduler complain on
  // stderr.
  if (context.threads > 0) cv::setNumThreads(std::min(context.threads, cv::getNumberOfCPUs()));
}

int run_checked(int argc, const char* const* argv) {
  Context context;
  context.stop = stop_on_signals();
  // A closed pipe and a limit of file sizes are errors of write(), and get their line.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  silence_libraries();

  CLI::App app("classical computer vision on an ordinary CPU, offline", "tarsier");
  app.set_version_flag("--version", fmt::format("tarsier {}", version()));
  app.require_subcommand(0, 1);
  add_cartoon(app, context);
  add_plate(app, context);
  add_sfm(app, context);
  add_calibrate(app, context);
  add_ar(app, context);
  add_landmarks(app, context);
  add_aam(app, context);
  add_pose(app, context);
  add_people(app, context);
  add_models(app, context);
  add_doctor(app, context);
  add_demo(app, context);
  add_bench(app, context);
  add_help(app, context);

  std::vector<std::string> tokens(argv + std::min(argc, 1), argv + argc);
  try {
    size_t used = 0;
    const CLI::App* chosen = chosen_app(app, tokens, used);
    if (is_area(*chosen) && used == tokens.size()) {
      const std::string help = chosen == &app ? std::string(kHelp) : help_text(*chosen);
      std::fwrite(help.data(), 1, help.size(), stderr);
      return static_cast<int>(ExitStatus::kUsage);
    }
    check_words(app, tokens);
    tokens = with_config(app, std::move(tokens));
    std::reverse(tokens.begin(), tokens.end());  // CLI11 takes them from the end
    app.parse(tokens);
  } catch (const CLI::CallForHelp&) {
    const CLI::App* shown = &app;
    while (!shown->get_subcommands().empty()) shown = shown->get_subcommands().front();
    print_text(shown == &app ? std::string(kHelp) : help_text(*shown));
    return 0;
  } catch (const CLI::CallForVersion&) {
    print_text(fmt::format("tarsier {}\n", version()));
    return 0;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return 0;
    return fail(ExitStatus::kUsage, error.what());
  }
  complete(context);
  const ExitStatus status = context.run();
  context.progress.reset();
  print_text("");  // tells of a full disk or a closed pipe behind stdout
  return static_cast<int>(status);
}

}  // namespace

void add_common_flags(CLI::App& verb, Context& context) {
  const auto common = [](CLI::Option* option) { option->group("Common"); };
  verb.set_version_flag("--version", fmt::format("tarsier {}", version()))->group("");
  common(verb.add_flag("--json", context.json, "JSON lines on stdout, logs on stderr"));
  common(verb.add_flag("--quiet", context.quiet, "only warnings and errors on stderr"));
  common(verb.add_option("--seed", context.seed, "of everything random")
             ->check(CLI::Validator(
                 [](const std::string& text) {
                   return text.starts_with("-") ? "a seed is not negative" : std::string();
                 },
                 ""))
             ->capture_default_str());
  common(verb.add_option("--threads", context.threads, "0: all cores")
             ->check(CLI::Range(0, 1024))
             ->capture_default_str());
  common(verb.add_option("--log-level", context.log_level)
             ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
             ->capture_default_str());
  common(verb.add_option("--progress", context.progress_style, "how long work tells how far it is")
             ->check(CLI::IsMember({"auto", "bar", "json", "none"}))
             ->capture_default_str());
  // Read before the parser runs (with_config); here so that the parser knows it and --help shows
  // it.
  common(verb.add_option("--config", "TOML or INI file with values for these flags")
             ->type_name("FILE"));
}

void add_debug_flag(CLI::App& verb, Context& context) {
  verb.add_option("--debug-dir", context.debug_dir, "folder for the pictures of each stage")
      ->group("Output");
}

int run_program(int argc, const char* const* argv) {
  try {
    return run_checked(argc, argv);
  } catch (const Error& error) {
    return fail(error.status(), without_requirement(error.what()));
  } catch (const std::invalid_argument& error) {
    return fail(ExitStatus::kUsage, without_requirement(error.what()));
  } catch (const cv::Exception& error) {
    return fail(ExitStatus::kBadInput,
                fmt::format("OpenCV cannot do this: {} ({})", error.err, error.func));
  } catch (const std::bad_alloc&) {
    return fail(ExitStatus::kBadInput, "out of memory: the input is too large for this machine");
  } catch (const std::exception& error) {
    return fail(ExitStatus::kBadInput, error.what());
  }
}

void print_text(std::string_view text) {
  const bool whole = std::fwrite(text.data(), 1, text.size(), stdout) == text.size();
  if (!whole || std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    throw OutputError("standard output", std::strerror(errno));
  }
}

void print_json_line(const std::string& object) { print_text(object + '\n'); }

std::string_view version() { return TARSIER_VERSION; }

std::string_view main_help() { return kHelp; }

std::string program_folder() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  return error ? std::string() : program.parent_path().string();
}

std::string find_models_folder(const std::string& given) {
  const char* environment = std::getenv("TARSIER_MODELS");
  const std::string wanted = !given.empty() ? given : environment != nullptr ? environment : "";
  std::error_code error;
  if (!wanted.empty()) {
    if (!fs::is_directory(wanted, error)) throw InputError(wanted, "no such folder of models");
    return wanted;
  }
  const fs::path folder = program_folder();
  if (folder.empty()) return {};
  for (const fs::path& place : {folder / "../../../models", folder / "../share/tarsier/models"}) {
    if (fs::is_directory(place, error)) return place.lexically_normal().string();
  }
  return {};
}

std::string nearest_word(std::string_view word, const std::vector<std::string>& known) {
  const auto distance = [word](std::string_view other) {  // Levenshtein
    std::vector<size_t> row(other.size() + 1);
    std::iota(row.begin(), row.end(), size_t{0});
    for (size_t i = 1; i <= word.size(); ++i) {
      size_t diagonal = row[0];
      row[0] = i;
      for (size_t j = 1; j <= other.size(); ++j) {
        const size_t above = row[j];
        const size_t change = diagonal + (word[i - 1] == other[j - 1] ? 0 : 1);
        row[j] = std::min({above + 1, row[j - 1] + 1, change});
        diagonal = above;
      }
    }
    return row.back();
  };
  std::string best;
  if (word.size() > 64) return best;
  size_t least = std::max<size_t>(2, word.size() / 3) + 1;
  for (const std::string& name : known) {
    if (const size_t d = distance(name); d < least) {
      least = d;
      best = name;
    }
  }
  return best;
}

}  // namespace tarsier::cli
