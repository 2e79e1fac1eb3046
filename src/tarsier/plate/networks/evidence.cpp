// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/evidence.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/plate/networks/quad.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::plate {

double log_confidence(const Reading& reading) {
  return std::log(std::max(reading.confidence, 1e-5));
}

std::array<double, 4> CalibrationCurve::features(double odds) {
  return {1, odds, std::max(0.0, odds - 2), std::max(0.0, -1 - odds)};
}

double CalibrationCurve::operator()(double odds) const {
  const std::array<double, 4> x = features(odds);
  return std::inner_product(x.begin(), x.end(), weights.begin(), 0.0);
}

double PlateClassifier::log_odds(const PlateClassifierFeatures& features) const {
  return std::inner_product(features.begin(), features.end(), weights.begin(), 0.0);
}

PlateClassifierFeatures plate_classifier_features(const Detection& detection,
                                                  const Alignment& alignment,
                                                  const RegionText& text) {
  const double detector_score = std::clamp(static_cast<double>(detection.score), 1e-3, 1 - 1e-3);
  double sum = 0;
  for (const double confidence : text.confidences) sum += std::log(std::max(confidence, 1e-3));
  const auto length = static_cast<double>(text.text.size());
  std::string symbols = text.text;
  std::sort(symbols.begin(), symbols.end());
  symbols.erase(std::unique(symbols.begin(), symbols.end()), symbols.end());
  const double height = std::max(4.0, static_cast<double>(mean_height(alignment.text)));
  const bool has_digit = text.text.find_first_of("0123456789") != std::string::npos;
  return {1,
          log_odds(static_cast<double>(alignment.score)),
          std::log(detector_score / (1 - detector_score)),
          sum / std::max(1.0, length),
          std::min(0.0, std::log(height / 20)),
          length,
          has_digit ? 0.0 : 1.0,
          text.country.empty() ? 0.0 : 1.0,
          static_cast<double>(symbols.size()) / std::max(1.0, length),
          0};
}

void set_relative_evidence(const std::vector<Reading>& readings,
                           std::vector<PlateClassifierFeatures>& features) {
  constexpr float kMaxOverlap = 0.3F;
  constexpr double kMaxLead = 8;  // nats
  TARSIER_REQUIRE(readings.size() == features.size(), "{} readings, {} features", readings.size(),
                  features.size());
  const auto evidence = [](const Reading& reading) {
    return log_confidence(reading) + log_odds(reading.plate);
  };
  for (std::size_t i = 0; i < readings.size(); ++i) {
    double& lead = features[i].back();
    lead = 0;
    for (std::size_t k = 0; k < readings.size(); ++k) {
      if (k == i || box_overlap_of_smaller(readings[k].corners, readings[i].corners) > kMaxOverlap)
        continue;
      lead = std::max(lead, evidence(readings[k]) - evidence(readings[i]));
    }
    lead = std::min(lead, kMaxLead);
  }
}

}  // namespace tarsier::plate
