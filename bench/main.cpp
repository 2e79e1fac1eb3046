// SPDX-License-Identifier: MIT
// tarsier-bench: the program that `tarsier bench` starts.
#include "tarsier/core/stop.h"

#include "bench.h"
#include <algorithm>
#include <array>
#include <iterator>

namespace tarsier::cli {
namespace {

struct Benchmark {
  std::string_view name;
  ExitStatus (*run)(Context&, const BenchOptions&);
};
constexpr auto kBenchmarks = std::to_array<Benchmark>({
    {"aam", bench_aam},
    {"cartoon", bench_cartoon},
    {"eyes", bench_eyes},
    {"landmarks", bench_landmarks},
    {"people", bench_people},
    {"plate", bench_plate},
    {"calibrate", bench_calibrate},
    {"markers", bench_markers},
    {"posit", bench_posit},
    {"render", bench_render},
    {"sfm", bench_sfm},
    {"steady", bench_steady},
    {"targets", bench_targets},
});
static_assert(std::ranges::equal(kBenchmarks, kBenches, {}, &Benchmark::name, &BenchInfo::name),
              "the benchmarks are those of the command line");

ExitStatus run_bench(std::string_view name, const BenchOptions& options, Context& context) {
  const EndOnSignals at_once;
  return std::ranges::find(kBenchmarks, name, &Benchmark::name)->run(context, options);
}

void add(Command& app, Context& context) {
  app.add_version_flag("--version");
  add_bench(app, context, run_bench);
  add_examples(app);
}

}  // namespace
}  // namespace tarsier::cli

int main(int argc, char** argv) {
  namespace cli = tarsier::cli;
  return cli::run_main({cli::add, {}}, argc, argv, "bench");
}
