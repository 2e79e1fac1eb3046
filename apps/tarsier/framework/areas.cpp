// SPDX-License-Identifier: MIT
#include "framework/areas.h"

#include "framework/companion.h"
#include "verbs/program/bench_flags.h"
#include "verbs/program/demo_flags.h"
#include "verbs/program/serve_flags.h"
#include <span>

namespace tarsier::cli {
namespace {

constexpr const char* kHelp = R"(tarsier - classical computer vision on an ordinary CPU, offline

  tarsier <area> <verb> [inputs] [flags]

See what it does, then use your own pictures, then your camera:

  tarsier demo                                   a page of pictures: demo-out/index.html
  tarsier cartoon run photo.jpg -o drawn.png     an image becomes a cartoon
  tarsier landmarks track 0 --window             68 points of each face, live
  tarsier plate read car.jpg                     a number plate
  tarsier sfm reconstruct photos/ -o model       cameras and a cloud of points

Areas:
  cartoon run              cartoons of pictures, videos and live cameras
  landmarks fit|track|..   points of faces: annotate, train, fit, follow, judge
  aam explore|fit|..       appearance models: train, play with, fit
  pose track|solve|..      where heads look; the pose of a known object; a head in 3D
  people enroll|live|..    who is it, or unknown: enrol, identify, forget, judge
  plate read|train-..|..   number plates: read, train, judge, log
  sfm reconstruct|eval|..  images to camera poses and a point cloud
  calibrate                a camera's lens from pictures of a printed board
  ar marker-sheet|..       printed markers: sheets of them, and boards for calibrate
  models list|info|verify  the trained models that came with the program
  doctor                   what this machine has, and what to do about what it lacks
  demo                     runs every area once and makes a page of it
  serve                    the studio: all of it in a browser, on this machine
  bench NAME               how fast it is here

An input is a picture, a folder, a glob, @list.txt, a video, a camera number or a URL.
Everywhere: -o OUT, --json, --quiet, --threads N, --config FILE; `--help` after any verb.
Exit status: 0 done, 1 nothing found, 2 usage, 3 bad input, 4 source lost, 5 bad model,
6 cannot write, 130 interrupted. `tarsier --version` tells the version.
)";

}  // namespace

void add_areas(Command& app, Context& context) {
  app.add_version_flag("--version");
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
  // Programs of their own: what only they need is neither linked nor loaded here.
  const auto behind_area = [](const Context& given) { return std::span(given.words).subspan(1); };
  add_demo(app, context, [behind_area](const DemoOptions&, const Context& given) -> ExitStatus {
    become_companion("tarsier-demo", behind_area(given));
  });
  add_bench(
      app, context,
      [behind_area](std::string_view, const BenchOptions&, const Context& given) -> ExitStatus {
        become_companion("tarsier-bench", behind_area(given));
      });
  add_serve(app, context, [behind_area](const ServeOptions&, const Context& given) -> ExitStatus {
    become_companion("tarsier-serve", behind_area(given));
  });
  add_help(app, context);
  add_examples(app);
}

std::string_view main_help() { return kHelp; }

}  // namespace tarsier::cli
