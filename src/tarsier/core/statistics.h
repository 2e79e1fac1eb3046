// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

// Order statistics, confidence intervals of rates, log odds and their inverse.
namespace tarsier {

namespace detail {
// Indices into `count` >= 1 ascending values. They throw std::invalid_argument for a share outside
// 0..1.
[[nodiscard]] inline double checked_share(double share) {
  TARSIER_REQUIRE(share >= 0 && share <= 1, "{}: a share is 0 to 1", share);
  return share;
}
[[nodiscard]] inline std::size_t upper_rank(double share, std::size_t count) {
  const double position = checked_share(share) * static_cast<double>(count);
  return std::min(static_cast<std::size_t>(position), count - 1);
}
[[nodiscard]] inline std::size_t lower_rank(double share, std::size_t count) {
  return static_cast<std::size_t>(checked_share(share) * static_cast<double>(count - 1));
}
[[nodiscard]] inline std::size_t nearest_rank(double share, std::size_t count) {
  return static_cast<std::size_t>(
      std::lround(checked_share(share) * static_cast<double>(count - 1)));
}

template <class T>
[[nodiscard]] T value_at_rank(std::vector<T>& values, std::size_t rank) {
  const auto position = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), position, values.end());
  return *position;
}
}  // namespace detail

// Quantiles that are one of the n values; 0 for no values. The values are reordered. The functions
// differ in the index into the ascending values. `share` is in 0..1 (else std::invalid_argument):
//   upper    floor(share n), n - 1 at most: the upper median for an even n
//   lower    floor(share (n - 1)): the lower median for an even n
//   nearest  share (n - 1), rounded, halves up: the upper median for an even n
template <class T>
[[nodiscard]] T upper_quantile(std::vector<T>& values, double share) {
  if (values.empty()) return T{};
  return detail::value_at_rank(values, detail::upper_rank(share, values.size()));
}
template <class T>
[[nodiscard]] T lower_quantile(std::vector<T>& values, double share) {
  if (values.empty()) return T{};
  return detail::value_at_rank(values, detail::lower_rank(share, values.size()));
}
template <class T>
[[nodiscard]] T nearest_quantile(std::vector<T>& values, double share) {
  if (values.empty()) return T{};
  return detail::value_at_rank(values, detail::nearest_rank(share, values.size()));
}

// The median; for an even number of values the upper one of the two in the middle. 0 for no values.
template <class T>
[[nodiscard]] T upper_median(std::vector<T> values) {
  return upper_quantile(values, 0.5);
}
[[nodiscard]] inline double upper_median(std::vector<double> values) {
  return upper_quantile(values, 0.5);
}

// The value below which the share `share` (0..1) of the ascending `sorted` values lies, linearly
// interpolated between neighbours: sorted[share (n - 1)]. 0 for no values. Throws
// std::invalid_argument for a share outside 0..1.
[[nodiscard]] double quantile(std::span<const double> sorted, double share);

struct Interval {
  double low = 0;
  double high = 1;
};

// The confidence interval of the true rate of an event that occurred `successes` times in `trials`
// independent trials, at the level `confidence` (E. B. Wilson, "Probable inference, the law of
// succession, and statistical inference", JASA 22, 1927):
//   (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n),  p = successes / n, n = trials,
// with z the two-sided normal quantile. The interval is within 0..1 and its width is never 0. It is
// 0..1 for no trials. Throws std::invalid_argument unless 0 <= successes <= trials and 0 <
// confidence < 1.
[[nodiscard]] Interval wilson_interval(long successes, long trials, double confidence = 0.95);

// The same for a rate in 0..1 that is the mean of several counts over the same cases, such as
// random draws from one set of images. `trials` >= 0 is then the number of trials of one count,
// because repeated counts over the same cases add little information.
[[nodiscard]] Interval wilson_interval_of_rate(double rate, double trials,
                                               double confidence = 0.95);

// ln(p / (1 - p)), with p clamped to margin..1 - margin (0 < margin < 0.5).
[[nodiscard]] double log_odds(double p, double margin = 1e-4);

// The logistic function 1 / (1 + exp(-x)), inverse of the log odds. Exact to a few roundings for
// every x: where exp(-x) overflows the result is 0, and nothing is subtracted from 1.
template <std::floating_point T>
[[nodiscard]] T logistic(T x) {
  return 1 / (1 + std::exp(-x));
}

}  // namespace tarsier
