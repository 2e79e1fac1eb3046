// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/plate/train/logistic.h"
#include "tarsier/plate/train/training.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

namespace tarsier::plate {
namespace {

using Features = CalibrationFeatures;
}  // namespace

Calibration fit_calibration(const Recognizer& recognizer, const ViewGenerator& views, int count,
                            std::uint64_t seed, Progress& progress, const std::stop_token& stop) {
  TARSIER_REQUIRE(count >= 100, "{} plates are too few", count);
  const Rng base(seed);
  std::vector<Features> rows(static_cast<std::size_t>(count));
  std::vector<int> labels(static_cast<std::size_t>(count), -1);
  progress.begin("calibration", count, "plates");
  constexpr int kBlock = 200;
  for (int first = 0; first < count; first += kBlock) {
    throw_if_stopped(stop);
    const int last = std::min(count, first + kBlock);
    cv::parallel_for_(cv::Range(first, last), [&](const cv::Range& range) {
      for (int i = range.start; i < range.end; ++i) {
        Rng rng = base.fork(static_cast<std::uint64_t>(i));
        ViewOptions options;
        options.drawn = 1;
        options.none = 0;
        options.centred = true;
        // Half of them are ordinary plates, half are wild ones.
        options.wild = views.wild && i % 2 == 0;
        options.valid_text = views.wild && !options.wild;
        const double width = 40 * std::pow(6.0, rng.uniform());
        options.min_width = width;
        options.max_width = width * 1.02;
        options.size = {static_cast<int>(width * 1.6), static_cast<int>(width)};
        const View view = views.make(options, rng);
        if (view.plates.empty() || view.plates.back().symbols.empty()) continue;
        const ViewPlate& plate = view.plates.back();
        std::string text;
        for (const ViewPlate::Symbol& symbol : plate.symbols) text += symbol.symbol;
        const Reading reading =
            recognizer.read_at(view.gray, plate.plate, &rows[static_cast<std::size_t>(i)]);
        if (reading.text.empty()) continue;
        // Ordinary plates are too easy for fitting the two logits.
        if (!views.wild)
          rows[static_cast<std::size_t>(i)][5] = rows[static_cast<std::size_t>(i)][6] = 0;
        labels[static_cast<std::size_t>(i)] = reading.text == text ? 1 : 0;
      }
    });
    progress.advance(last - first);
  }
  progress.end();
  LogisticRows used;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (labels[i] >= 0) used.add({rows[i].begin(), rows[i].end()}, labels[i] == 1);
  const std::vector<double> weights =
      fit_logistic(used, std::vector<double>(std::tuple_size_v<Features>, 1e-2));
  Calibration result;
  std::copy(weights.begin(), weights.end(), result.weights.begin());
  return result;
}

}  // namespace tarsier::plate
