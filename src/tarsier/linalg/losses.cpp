// SPDX-License-Identifier: MIT
#include "tarsier/linalg/losses.h"

#include "tarsier/core/statistics.h"

#include <algorithm>
#include <cmath>

namespace tarsier::linalg {

double logistic_loss(float logit, float label, float& derivative) {
  const double p = logistic(static_cast<double>(logit));
  derivative = static_cast<float>(p - static_cast<double>(label));
  return label > 0.5F ? -std::log(std::max(p, 1e-9)) : -std::log(std::max(1 - p, 1e-9));
}

double huber(float error, float delta, float& derivative) {
  const float size = std::abs(error);
  derivative = std::clamp(error / delta, -1.0F, 1.0F);
  return static_cast<double>(size < delta ? error * error / (2 * delta) : size - delta / 2);
}

double map_loss(const MapLoss& form, const std::vector<float>& target,
                const std::vector<float>& output, Shape shape, std::vector<float>& derivative) {
  const auto plane = static_cast<std::size_t>(shape.height) * static_cast<std::size_t>(shape.width);
  double loss = 0;
  int positives = 0;
  for (std::size_t i = 0; i < plane; ++i) positives += target[i] > 0.5F ? 1 : 0;
  const float share = form.weight / static_cast<float>(std::max(1, positives));
  for (std::size_t i = 0; i < plane; ++i) {
    const float label = target[i];
    if (label == kIgnoredCell) continue;
    float slope = 0;
    const double raw = logistic_loss(output[i], label, slope);
    // The focal weight is treated as a constant in the derivative.
    const float weight = label > 0.5F ? share : slope * slope * form.focal;
    loss += raw * static_cast<double>(weight);
    derivative[i] = slope * weight;
    if (target[plane + i] <= 0) continue;
    for (std::size_t k = 1; k <= static_cast<std::size_t>(form.values); ++k) {
      float d = 0;
      const float error = output[k * plane + i] - target[(1 + k) * plane + i];
      loss += static_cast<double>(share) * huber(error, form.huber_delta, d);
      derivative[k * plane + i] = share * d;
    }
  }
  return loss;
}

}  // namespace tarsier::linalg
