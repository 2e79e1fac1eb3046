// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"

#include "bench.h"
#include "cli.h"
#include <memory>

namespace tarsier::cli {
namespace {

// A row for each area that measures its speed.
struct Benchmark {
  const char* name;
  const char* help;
  ExitStatus (*run)(Context&, const BenchOptions&);
};

const std::vector<Benchmark>& benchmarks() {
  static const std::vector<Benchmark> table = {
      {"aam", "fitting an appearance model: an iteration, a fit, a video with the head's pose",
       bench_aam},
      {"cartoon", "every mode at three sizes: reference against fast, speed and likeness",
       bench_cartoon},
      {"eyes", "how often each way finds both eyes of a face, and how long it takes", bench_eyes},
      {"landmarks", "fitting the points of a face by each method, and following it",
       bench_landmarks},
      {"people", "a gallery that grows: enrol, learn, name, forget; --size: faces, e.g. 100000",
       bench_people},
      {"plate", "finding, aligning and reading number plates", bench_plate},
      {"calibrate", "boards of a calibration: found how exactly and how fast, the camera they give",
       bench_calibrate},
      {"markers", "markers found in drawn scenes, beside OpenCV's aruco and the AprilTag library",
       bench_markers},
      {"posit", "the pose of a simulated head: error and time of POSIT beside SQPNP", bench_posit},
      {"render", "drawing a mesh of ten thousand triangles into a picture", bench_render},
      {"steady", "how much less the lines of a video flicker with --steady", bench_steady},
      {"targets",
       "pictures found in stills and followed through videos, beside ORB and SIFT with RANSAC",
       bench_targets},
  };
  return table;
}

}  // namespace

void add_bench(Command& app, Context& context) {
  Command& bench = app.add_subcommand("bench", "measures how fast things are on this machine");
  bench.require_subcommand(1);
  const auto options = std::make_shared<BenchOptions>();
  for (const Benchmark& benchmark : benchmarks()) {
    Command& verb = bench.add_subcommand(benchmark.name, benchmark.help);
    verb.add_option("INPUT", options->inputs,
                    "pictures to measure on (default: the benchmark's own)");
    verb.add_option("--repeats", options->repeats,
                    "runs per case, after one to warm up; the median counts")
        .check(range(1, 100000))
        .show_default();
    verb.add_option("--size", options->sizes, "only these sizes, e.g. 640x480").delimiter(',');
    verb.add_option("--only", options->only, "only these cases, e.g. sketch,paint").delimiter(',');
    if (benchmark.run == bench_cartoon) {
      verb.add_flag("--stages", options->stages, "where the time goes: a line for each stage");
    }
    add_common_flags(verb, context);
    set_run(verb, context, [&context, options, run = benchmark.run] {
      const EndOnSignals at_once;
      return run(context, *options);
    });
  }
}

}  // namespace tarsier::cli
