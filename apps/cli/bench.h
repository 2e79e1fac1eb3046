// SPDX-License-Identifier: MIT
#pragma once

#include "cli.h"
#include <string>
#include <vector>

namespace tarsier::cli {

struct BenchOptions {
  std::vector<std::string> inputs;  // pictures to measure on; empty: the benchmark's own
  int repeats = 15;                 // measured runs per case, >= 1; the median counts
  std::vector<std::string> sizes;   // "640x480" ..; empty: the benchmark's own
  std::vector<std::string> only;    // names of cases (modes); empty: all
  bool stages = false;              // cartoon: where the time of a frame goes
};

// Each prints a table, or with context.json one object per measured case: "bench" is its own name,
// "case" tells the lines of one bench apart, and times are in "ms", "us" or fields that end in
// "_ms" (medians or averages; scripts/bench-compare.sh takes them for figures that two builds can
// be compared by).
[[nodiscard]] ExitStatus bench_aam(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_cartoon(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_steady(Context& context,
                                      const BenchOptions& options);  // uses the first input
[[nodiscard]] ExitStatus bench_plate(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_landmarks(Context& context,
                                         const BenchOptions& options);  // INPUT: a face
// INPUT: pictures without a board
[[nodiscard]] ExitStatus bench_calibrate(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_markers(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_render(Context& context, const BenchOptions& options);
// INPUT: pictures to find
[[nodiscard]] ExitStatus bench_targets(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_posit(Context& context,
                                     const BenchOptions& options);  // INPUT: another head model

// INPUT: pictures or videos with faces
[[nodiscard]] ExitStatus bench_eyes(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_people(Context& context, const BenchOptions& options);

}  // namespace tarsier::cli
