// SPDX-License-Identifier: MIT
#pragma once

#include "verbs/program/bench_flags.h"
#include <algorithm>
#include <string_view>

namespace tarsier::cli {

// Whether `--only` selects the case `name`.
[[nodiscard]] inline bool is_chosen(const BenchOptions& options, std::string_view name) {
  return options.only.empty() ||
         std::find(options.only.begin(), options.only.end(), name) != options.only.end();
}

// Each function prints a table, or with context.json one object per case: "bench" is its name,
// "case" identifies the line, and times are in "ms", "us" or fields that end in "_ms" (medians or
// averages; scripts/bench-compare.sh compares two builds by them).
[[nodiscard]] ExitStatus bench_aam(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_cartoon(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_steady(Context& context,
                                      const BenchOptions& options);  // uses the first input
[[nodiscard]] ExitStatus bench_plate(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_landmarks(Context& context,
                                         const BenchOptions& options);  // INPUT: a face
// INPUT: images without a board
[[nodiscard]] ExitStatus bench_calibrate(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_markers(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_render(Context& context, const BenchOptions& options);
// INPUT: images of a scene
[[nodiscard]] ExitStatus bench_sfm(Context& context, const BenchOptions& options);
// INPUT: images to find
[[nodiscard]] ExitStatus bench_targets(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_posit(Context& context,
                                     const BenchOptions& options);  // INPUT: another head model

// INPUT: images or videos with faces
[[nodiscard]] ExitStatus bench_eyes(Context& context, const BenchOptions& options);
[[nodiscard]] ExitStatus bench_people(Context& context, const BenchOptions& options);

}  // namespace tarsier::cli
