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
// Indices into `count` >= 1 ascending values; throw std::invalid_argument for a share outside 0..1.
[[nodiscard]] inline double checked_share(double share) {
  TARSIER_REQUIRE(share >= 0 && share <= 1, "{}: a share is 0 to 1", share);
  return share;
}
[[nodiscard]] inline std::size_t upper_rank(double share, std::size_t count) {
  const double place = checked_share(share) * static_cast<double>(count);
  return std::min(static_cast<std::size_t>(place), count - 1);
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
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), place, values.end());
  return *place;
}
}  // namespace detail

// Quantiles that are one of the n values, which are put into another order; 0 for no values. They
// differ in the index that they take of the ascending values, with `share` in 0..1 (else
// std::invalid_argument):
//   upper    floor(share n), n - 1 at most: of an even number the upper median
//   lower    floor(share (n - 1)): of an even number the lower median
//   nearest  share (n - 1), rounded, halves up: of an even number the upper median
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

// The median; of an even number of values the upper one of the two in the middle. 0 for no values.
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

// The interval in which the true rate of an event lies with the chance `confidence`, after it was
// seen `successes` times in `trials` independent trials (E. B. Wilson, "Probable inference, the law
// of succession, and statistical inference", JASA 22, 1927):
//   (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2)) / (1 + z^2/n),  p = successes / n, n = trials,
// with z the two-sided normal quantile. Within 0..1, never of no width; 0..1 where nothing was
// tried. Throws std::invalid_argument unless 0 <= successes <= trials and 0 < confidence < 1.
[[nodiscard]] Interval wilson_interval(long successes, long trials, double confidence = 0.95);

// The same for a rate in 0..1 that is the mean over several counts of the same cases, such as
// random draws from one set of images: `trials` >= 0 are then those of one count, as repeating it
// on the same cases adds little.
[[nodiscard]] Interval wilson_interval_of_rate(double rate, double trials,
                                               double confidence = 0.95);

// ln(p / (1 - p)), with p kept `margin` (> 0, < 0.5) from 0 and from 1.
[[nodiscard]] double log_odds(double p, double margin = 1e-4);

// The logistic function 1 / (1 + exp(-x)), inverse of the log odds. Exact to a few roundings for every
// x: where exp(-x) overflows the result is 0, and nothing is subtracted from 1.
template <std::floating_point T>
[[nodiscard]] T logistic(T x) {
  return 1 / (1 + std::exp(-x));
}

}  // namespace tarsier
