// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <concepts>

namespace tarsier::cartoon {

// Number of bands that for_row_bands makes of `rows` rows.
inline int number_of_bands(int rows) {
  constexpr int kMinRows = 8;  // smaller bands are not worth a thread
  return std::max(1, std::min(cv::getNumThreads(), rows / kMinRows));
}

// Calls work(band, first, last) for disjoint bands that cover rows 0..rows-1, on
// cv::getNumThreads() threads. Allocates no memory. The bands depend on the number of threads, so a
// result must not depend on the bands.
template <typename Work>
requires std::invocable<Work, int, int, int>
void for_row_bands(int rows, const Work& work) {
  const int bands = number_of_bands(rows);
  if (bands == 1) {
    work(0, 0, rows);
    return;
  }
  class Body final : public cv::ParallelLoopBody {
   public:
    Body(const Work& todo, int rows, int bands) : todo_(todo), rows_(rows), bands_(bands) {}
    void operator()(const cv::Range& range) const override {
      for (int band = range.start; band < range.end; ++band)
        todo_(band, start(band), start(band + 1));
    }

   private:
    [[nodiscard]] int start(int band) const {
      return static_cast<int>(static_cast<long long>(rows_) * band / bands_);
    }
    const Work& todo_;
    int rows_;
    int bands_;
  };
  cv::parallel_for_(cv::Range(0, bands), Body(work, rows, bands), bands);
}

// The same for work(first, last).
template <typename Work>
requires std::invocable<Work, int, int>
void for_row_bands(int rows, const Work& work) {
  for_row_bands(rows, [&](int /*band*/, int first, int last) { work(first, last); });
}

}  // namespace tarsier::cartoon
