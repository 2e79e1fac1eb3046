// SPDX-License-Identifier: MIT
// tarsier-demo: the program that `tarsier demo` starts.
#include "tarsier/core/cpu.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include "demo.h"
#include "framework/stopwatch.h"
#include "verbs/program/demo_flags.h"
#include <algorithm>
#include <array>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

namespace tarsier::cli {
namespace {

// One row per area, in the order of the page.
struct DemoStep {
  std::string_view name;
  void (*run)(Context&, DemoPage&);
};
constexpr auto kSteps = std::to_array<DemoStep>({
    {"cartoon", demo_cartoon},
    {"sfm", demo_sfm},
    {"plate", demo_plate},
    {"landmarks", demo_landmarks},
    {"aam", demo_aam},
    {"pose", demo_pose},
    {"people", demo_people},
    {"calibrate", demo_calibrate},
    {"markers", demo_markers},
    {"targets", demo_targets},
});
static_assert(std::ranges::equal(kSteps, kDemoAreas, {}, &DemoStep::name),
              "expected areas of the command line");

// How a user starts `tarsier` from here: by name if it is installed, else by its path.
std::string shell_command() {
  namespace fs = std::filesystem;
  // If installed, this program is in libexec/tarsier, and tarsier in bin, which is in PATH.
  const fs::path sibling = fs::path(program_folder()) / "tarsier";
  std::error_code error;
  if (!fs::exists(sibling, error)) return "tarsier";
  const fs::path path = fs::relative(sibling, error);
  return error || path.native().starts_with("..") ? sibling.string() : path.string();
}

ExitStatus run_demo(const DemoOptions& options, Context& context) {
  const Stopwatch watch;
  DemoPage page(options.output);
  int done = 0;
  for (const DemoStep& step : kSteps) {
    throw_if_stopped(context.stop);
    if (!options.only.empty() &&
        std::find(options.only.begin(), options.only.end(), step.name) == options.only.end()) {
      continue;
    }
    log_info("demo: {}", step.name);
    step.run(context, page);
    ++done;
  }
  const double seconds = watch.seconds();
  const std::string path = page.write(
      "Tarsier demo",
      "Classical computer vision on an ordinary CPU, offline. Everything on this page was just "
      "computed on this machine, by the command beside it.",
      fmt::format(
          "Made on {:%Y-%m-%d %H:%M} by tarsier {} in {:.0f} s: {} cores, {} vectors, OpenCV {}.",
          fmt::localtime(std::time(nullptr)), version(), seconds,
          std::max(1U, std::thread::hardware_concurrency()), tarsier::name_of(simd_level()),
          cv::getVersionString()));
  if (context.json) {
    print_json(nlohmann::json{{"page", path}, {"areas", done}, {"seconds", seconds}});
  } else {
    const std::string absolute = std::filesystem::absolute(path).lexically_normal().string();
    print_text(
        fmt::format("The page was written after {:.0f} s. Open it in a browser:\n  {}\n"
                    "For your own images and camera, start the studio in a browser:\n  {} serve\n",
                    seconds, printable(absolute), printable(shell_command())));
  }
  return ExitStatus::kDone;
}

void add(Command& app, Context& context) {
  app.add_version_flag("--version");
  add_demo(app, context, run_demo);
  add_examples(app);
}

}  // namespace
}  // namespace tarsier::cli

int main(int argc, char** argv) {
  namespace cli = tarsier::cli;
  return cli::run_main({cli::add, {}}, argc, argv, "demo");
}
