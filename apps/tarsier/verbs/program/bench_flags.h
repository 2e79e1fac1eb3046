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
    {"aam", "fit of an appearance model: an iteration, a fit, a video with head pose"},
    {"cartoon", "all modes at three sizes: fast against reference, speed and similarity"},
    {"eyes", "success rate and time of each eye finder"},
    {"landmarks", "landmark fit by each method, and tracking"},
    {"people", "a growing gallery: enrol, train, identify, delete; --size: faces, e.g. 100000"},
    {"plate", "detection, alignment and reading of number plates"},
    {"calibrate", "board detection and calibration: accuracy and time"},
    {"markers", "marker detection in synthetic scenes, against OpenCV's aruco and AprilTag"},
    {"posit", "pose of a simulated head: error and time of POSIT against SQPNP"},
    {"render", "rendering of a mesh of ten thousand triangles"},
    {"sfm", "reconstruction of synthetic rings of 12 and 60 images: time and counts of each stage"},
    {"steady", "flicker reduction of lines in videos by --steady"},
    {"targets", "target detection and tracking, against ORB and SIFT with RANSAC"},
});

// Adds `bench` with one verb for each entry of kBenches; `run` gets the name of the chosen verb.
using RunBench = std::function<ExitStatus(std::string_view, const BenchOptions&, Context&)>;
void add_bench(Command& app, Context& context, const RunBench& run);

}  // namespace tarsier::cli
