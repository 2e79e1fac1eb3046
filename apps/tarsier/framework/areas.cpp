// SPDX-License-Identifier: MIT
#include "framework/areas.h"

#include "framework/companion.h"
#include "verbs/program/bench_flags.h"
#include "verbs/program/demo_flags.h"
#include "verbs/program/serve_flags.h"
#include <algorithm>
#include <iterator>
#include <span>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

constexpr const char* kHelp = R"(tarsier - classical computer vision on an ordinary CPU, offline

  tarsier <area> <verb> [inputs] [flags]

Start with the demo, then use your own images or camera:
  tarsier demo                                   a page of examples: demo-out/index.html
  tarsier cartoon run photo.jpg -o drawn.png     convert an image to a cartoon
  tarsier landmarks track 0 --window             68 landmarks of each face, live
  tarsier plate read car.jpg                     read a number plate
  tarsier sfm reconstruct photos/ -o model       reconstruct cameras and a point cloud

Areas:
  cartoon run              cartoons of images, videos and live cameras
  landmarks fit|track|..   landmarks of faces: annotate, train, fit, track, evaluate
  aam explore|fit|..       appearance models: train, explore, fit
  pose track|solve|..      head poses; poses of known objects; a 3D head model
  people enroll|live|..    face recognition: enrol, identify, delete, evaluate
  plate read|train-..|..   number plates: read, train, evaluate, log
  sfm reconstruct|mesh|..  camera poses, point clouds and surfaces from images
  calibrate                calibrate a camera from images of a printed board
  ar marker-sheet|..       printed markers and calibration boards; image targets
  models list|info|verify  the trained models shipped with the program
  doctor                   check what this machine has and lacks, with advice
  hub, merge               store events of many cameras (MQTT); merge files of shards
  demo                     run every area once and write a page of the results
  serve                    run the studio: everything in a browser, on this machine
  bench NAME               measure speed on this machine

An input is an image, a folder, a glob, @list.txt, a video, a camera number or a URL.
Everywhere: -o OUT, --json, --quiet, --threads N, --config FILE; `--help` after any verb.
Exit status: 0 done, 1 nothing found, 2 usage, 3 bad input, 4 source lost, 5 bad model,
6 cannot write, 130 interrupted. `tarsier --version` prints the version.
)";

// Separate programs, so that what only they need is neither linked nor loaded here.
std::span<const std::string> words_after_area(const Context& given) {
  return std::span(given.words).subspan(1);
}

void add_companion_demo(Command& app, Context& context) {
  add_demo(app, context, [](const DemoOptions&, const Context& given) -> ExitStatus {
    become_companion("tarsier-demo", words_after_area(given));
  });
}

void add_companion_bench(Command& app, Context& context) {
  add_bench(app, context,
            [](std::string_view, const BenchOptions&, const Context& given) -> ExitStatus {
              become_companion("tarsier-bench", words_after_area(given));
            });
}

void add_companion_serve(Command& app, Context& context) {
  add_serve(app, context, [](const ServeOptions&, const Context& given) -> ExitStatus {
    become_companion("tarsier-serve", words_after_area(given));
  });
}

struct Area {
  std::string_view name;  // of the verb that it adds
  void (*add)(Command& app, Context& context);
};

constexpr Area kAreas[] = {
    {"cartoon", add_cartoon},
    {"plate", add_plate},
    {"sfm", add_sfm},
    {"calibrate", add_calibrate},
    {"ar", add_ar},
    {"landmarks", add_landmarks},
    {"aam", add_aam},
    {"pose", add_pose},
    {"people", add_people},
    {"models", add_models},
    {"doctor", add_doctor},
    {"hub", add_hub},
    {"merge", add_merge},
    {"demo", add_companion_demo},
    {"bench", add_companion_bench},
    {"serve", add_companion_serve},
    {"help", add_help},
};

// The only area whose flags the parser needs for this command line. Empty if it needs all areas:
// for help, which lists them, and for --config, whose file may have sections of any area.
std::string needed_area(const std::vector<std::string>& words) {
  if (words.empty() || words[0] == "help") return {};
  const bool known = std::any_of(std::begin(kAreas), std::end(kAreas),
                                 [&](const Area& area) { return area.name == words[0]; });
  const bool configured = std::any_of(words.begin(), words.end(), [](const std::string& word) {
    return word.starts_with("--config");
  });
  return known && !configured ? words[0] : std::string();
}

}  // namespace

void add_areas(Command& app, Context& context) {
  app.add_version_flag("--version");
  app.require_subcommand(0, 1);
  const std::string needed = needed_area(context.words);
  for (const Area& area : kAreas) {
    if (needed.empty() || needed == area.name) area.add(app, context);
  }
  add_examples(app);
}

std::string_view main_help() { return kHelp; }

}  // namespace tarsier::cli
