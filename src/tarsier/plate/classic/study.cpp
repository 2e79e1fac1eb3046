// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/study.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <exception>
#include <mutex>
#include <numeric>

namespace tarsier::plate {

void StudyOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!thumbnail_sizes.empty() && !neurons.empty(), "nothing to study");
}

double StudyCell::mean() const {
  return errors.empty() ? 0
                        : std::accumulate(errors.begin(), errors.end(), 0.0) /
                              static_cast<double>(errors.size());
}

double StudyCell::deviation() const {
  if (errors.size() < 2) return 0;
  const double average = mean();
  double squares = 0;
  for (const double error : errors) squares += (error - average) * (error - average);
  return std::sqrt(squares / static_cast<double>(errors.size() - 1));
}

std::vector<StudyCell> study_reader(const CharacterSet& set, const StudyOptions& options,
                                    Progress& progress, const std::stop_token& stop) {
  options.check();
  std::vector<StudyCell> cells;
  const bool has_neurons = options.kind == ReaderKind::kMlp;
  if (has_neurons) {
    for (const int thumbnail_size : options.thumbnail_sizes)
      for (const int neurons : options.neurons)
        cells.push_back({thumbnail_size, neurons,
                         std::vector<double>(static_cast<std::size_t>(options.seeds), 0)});
  } else {
    cells.push_back({20, 0, std::vector<double>(static_cast<std::size_t>(options.seeds), 0)});
  }
  const int jobs = static_cast<int>(cells.size()) * options.seeds;
  progress.begin("sweep", jobs, "readers");
  const Rng base(options.seed);
  std::mutex mutex;
  std::exception_ptr error;
  cv::parallel_for_(
      cv::Range(0, jobs),
      [&](const cv::Range& range) {
        for (int job = range.start; job < range.end; ++job) {
          try {
            throw_if_stopped(stop);
            const auto number = static_cast<std::uint64_t>(job % options.seeds);
            StudyCell& cell = cells[static_cast<std::size_t>(job / options.seeds)];
            // All cells use the same splits.
            const CharacterSplit split =
                split_characters(set, options.train, base.fork(2 * number));
            CharacterReaderOptions reader_options;
            reader_options.kind = options.kind;
            reader_options.thumbnail_size = cell.thumbnail_size;
            reader_options.mlp.hidden = std::max(1, cell.neurons);
            reader_options.mlp.iterations = options.iterations;
            const CharacterReader reader = train_character_reader(set, split.train, reader_options,
                                                                  base.fork(2 * number + 1), stop);
            cell.errors[number] = character_error(reader, set, split.test);
            const std::lock_guard lock(mutex);
            progress.advance();
          } catch (...) {
            const std::lock_guard lock(mutex);
            if (!error) error = std::current_exception();
            return;
          }
        }
      },
      static_cast<double>(jobs));
  if (error) std::rethrow_exception(error);
  progress.end();
  return cells;
}

std::string study_csv(const std::vector<StudyCell>& cells) {
  std::string text = "features,neurons,splits,error_mean,error_deviation\n";
  for (const StudyCell& cell : cells)
    text += fmt::format("{},{},{},{:.5f},{:.5f}\n", cell.thumbnail_size, cell.neurons,
                        cell.errors.size(), cell.mean(), cell.deviation());
  return text;
}

}  // namespace tarsier::plate
