// SPDX-License-Identifier: MIT
#include "tarsier/core/cpu.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include "demo.h"
#include "framework/stopwatch.h"
#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

namespace tarsier::cli {
namespace {

// A row for each area, in the order of the page.
struct DemoStep {
  const char* name;
  void (*run)(Context&, DemoPage&);
};

const std::vector<DemoStep>& steps() {
  static const std::vector<DemoStep> table = {
      {"cartoon", demo_cartoon}, {"sfm", demo_sfm},
      {"plate", demo_plate},     {"landmarks", demo_landmarks},
      {"aam", demo_aam},         {"pose", demo_pose},
      {"people", demo_people},   {"calibrate", demo_calibrate},
      {"markers", demo_markers}, {"targets", demo_targets},
  };
  return table;
}

struct DemoOptions {
  std::string output = "demo-out";
  std::vector<std::string> only;
};

ExitStatus run_demo(const DemoOptions& options, Context& context) {
  const Stopwatch watch;
  DemoPage page(options.output);
  int done = 0;
  for (const DemoStep& step : steps()) {
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
      "What Tarsier sees",
      "Classical computer vision on an ordinary CPU, offline. Everything on this page was computed "
      "on this "
      "machine a moment ago, by the command that stands beside it.",
      fmt::format(
          "Made on {:%Y-%m-%d %H:%M} by tarsier {} in {:.0f} s: {} cores, {} vectors, OpenCV {}.",
          fmt::localtime(std::time(nullptr)), version(), seconds,
          std::max(1U, std::thread::hardware_concurrency()), tarsier::name_of(simd_level()),
          cv::getVersionString()));
  if (context.json) {
    print_json(nlohmann::json{{"page", path}, {"areas", done}, {"seconds", seconds}});
  } else {
    const std::string absolute = std::filesystem::absolute(path).lexically_normal().string();
    print_text(fmt::format("The page is ready after {:.0f} s. Open it in a browser:\n  {}\n",
                           seconds, printable(absolute)));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, DemoOptions& options) {
  verb.add_option("-o,--output", options.output, "folder of the page").show_default();
  std::vector<std::string> names;
  for (const DemoStep& step : steps()) names.emplace_back(step.name);
  verb.add_option("--only", options.only, "only these areas").delimiter(',').check(one_of(names));
}

}  // namespace

void add_demo(Command& app, Context& context) {
  add_verb<DemoOptions>(app, "demo", "runs every area once and makes a page of it", context,
                        add_flags, run_demo);
}

}  // namespace tarsier::cli
