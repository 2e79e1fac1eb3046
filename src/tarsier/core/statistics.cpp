// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tarsier {
namespace {

// z with P(|standard normal| <= z) = confidence, by bisection.
double two_sided_quantile(double confidence) {
  double low = 0;
  double high = 40;
  for (int i = 0; i < 100; ++i) {
    const double center = (low + high) / 2;
    (std::erfc(center / std::numbers::sqrt2) > 1 - confidence ? low : high) = center;
  }
  return (low + high) / 2;
}

}  // namespace

double quantile(std::span<const double> sorted, double share) {
  (void)detail::checked_share(share);
  if (sorted.empty()) return 0;
  const double position = share * static_cast<double>(sorted.size() - 1);
  const auto low = static_cast<std::size_t>(position);
  const std::size_t high = std::min(low + 1, sorted.size() - 1);
  return sorted[low] + (position - static_cast<double>(low)) * (sorted[high] - sorted[low]);
}

Interval wilson_interval(long successes, long trials, double confidence) {
  TARSIER_REQUIRE(successes >= 0 && successes <= trials, "{} successes in {} trials", successes,
                  trials);
  const auto n = static_cast<double>(trials);
  return wilson_interval_of_rate(trials > 0 ? static_cast<double>(successes) / n : 0, n,
                                 confidence);
}

Interval wilson_interval_of_rate(double rate, double trials, double confidence) {
  TARSIER_REQUIRE(rate >= 0 && rate <= 1, "a rate of {}", rate);
  TARSIER_REQUIRE(trials >= 0 && std::isfinite(trials), "{} trials", trials);
  TARSIER_REQUIRE(confidence > 0 && confidence < 1, "a confidence of {}", confidence);
  if (trials == 0) return {0, 1};
  const double z = two_sided_quantile(confidence);
  const double share = z * z / trials;
  const double center = (rate + share / 2) / (1 + share);
  const double half =
      z * std::sqrt(rate * (1 - rate) / trials + share / (4 * trials)) / (1 + share);
  // Exact at the ends, where rounding would leave a small error.
  return {rate == 0 ? 0 : std::max(0.0, center - half),
          rate == 1 ? 1 : std::min(1.0, center + half)};
}

double log_odds(double p, double margin) {
  p = std::clamp(p, margin, 1 - margin);
  return std::log(p / (1 - p));
}

}  // namespace tarsier
