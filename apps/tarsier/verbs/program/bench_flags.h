// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <array>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

// The command line of `tarsier bench`. It is declared in two programs: tarsier documents it and
// starts tarsier-bench, and tarsier-bench measures (bench/).
namespace tarsier::cli {

struct BenchOptions {
  std::vector<std::string> inputs;  // images to measure on; empty: the benchmark's own
  int repeats = 15;                 // measured runs per case, >= 1; the median is reported
  std::vector<std::string> sizes;   // "640x480" ..; empty: the benchmark's own
  std::vector<std::string> only;    // names of cases (modes); empty: all
  bool stages = false;              // cartoon: time of each stage of a frame
};

struct BenchInfo {
  std::string_view name;
  std::string_view help;
};
inline constexpr auto kBenches = std::to_array<BenchInfo>({
    {"aam", "fitting an appearance model: an iteration, a fit, a video with the head's pose"},
    {"cartoon", "every mode at three sizes: reference against fast, speed and likeness"},
    {"eyes", "how often each way finds both eyes of a face, and how long it takes"},
    {"landmarks", "fitting the points of a face by each method, and following it"},
    {"people", "a gallery that grows: enrol, learn, name, forget; --size: faces, e.g. 100000"},
    {"plate", "finding, aligning and reading number plates"},
    {"calibrate", "boards of a calibration: found how exactly and how fast, the camera they give"},
    {"markers", "markers found in drawn scenes, beside OpenCV's aruco and the AprilTag library"},
    {"posit", "the pose of a simulated head: error and time of POSIT beside SQPNP"},
    {"render", "drawing a mesh of ten thousand triangles into an image"},
    {"sfm", "reconstruction of drawn rings of 12 and 60 images: seconds and counts of each stage"},
    {"steady", "how much less the lines of a video flicker with --steady"},
    {"targets",
     "images found in stills and followed through videos, beside ORB and SIFT with "
     "RANSAC"},
});

// Adds `bench` with one verb for each entry of kBenches; `run` gets the name of the chosen verb.
using RunBench = std::function<ExitStatus(std::string_view, const BenchOptions&, Context&)>;
void add_bench(Command& app, Context& context, const RunBench& run);

}  // namespace tarsier::cli
