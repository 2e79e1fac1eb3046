// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <vector>

// Order statistics, confidence intervals of rates, log odds.
namespace tarsier {

// The median; of an even number of values the upper one of the two in the middle. 0 for no values.
[[nodiscard]] double upper_median(std::vector<double> values);

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

}  // namespace tarsier
