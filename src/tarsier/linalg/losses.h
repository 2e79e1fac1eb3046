// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <vector>

// Losses shared by several trainings.
namespace tarsier::linalg {

// -log of the probability of the label (0 or 1) under a logit; writes the derivative by the logit.
[[nodiscard]] double logistic_loss(float logit, float label, float& derivative);

// Huber's loss (Annals of Mathematical Statistics, 1964) with its corner at `delta`; writes the
// derivative. Beyond the corner it is linear with slope 1.
[[nodiscard]] double huber(float error, float delta, float& derivative);

// Loss of detection maps. The output's planes: a logit, then `values` numbers per cell (the
// position). The target's planes: the label (1, 0, or kIgnoredCell), whether the numbers are known
// (> 0), the numbers.
inline constexpr float kIgnoredCell = -1;
struct MapLoss {
  int values = 4;
  float weight = 1;    // total weight of all positive cells
  float focal = 1.2F;  // weight of empty cells, times p^2 (Lin and others, "Focal loss", ICCV 2017)
  float huber_delta = 0.1F;  // of the Huber loss of the numbers
};
// `derivative` has the output's size and must be zero.
[[nodiscard]] double map_loss(const MapLoss& form, const std::vector<float>& target,
                              const std::vector<float>& output, Shape shape,
                              std::vector<float>& derivative);

}  // namespace tarsier::linalg
