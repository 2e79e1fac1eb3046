// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <vector>

// Losses that the trainings share.
namespace tarsier::linalg {

// -log of the probability that the label (0 or 1) is given by a logit; writes the derivative by it.
[[nodiscard]] double logistic_loss(float logit, float label, float& derivative);

// Huber's loss (Annals of Mathematical Statistics, 1964) with its corner at `knee`; writes the
// derivative. It is linear with a slope of 1 beyond.
[[nodiscard]] double huber(float error, float knee, float& derivative);

// Of maps that say for each cell whether something is there and where it lies. The output's planes:
// a logit, then `values` numbers. The target's: the label (1, 0, or kIgnoredCell), whether the
// numbers are known (> 0), the numbers.
inline constexpr float kIgnoredCell = -1;
struct MapLoss {
  int values = 4;
  float weight = 1;    // of all cells with something together
  float focal = 1.2F;  // of empty cells, times p^2 (Lin and others, "Focal loss", ICCV 2017)
  float knee = 0.1F;   // of the numbers' Huber loss
};
// `derivative` has the output's size and comes as zeros.
[[nodiscard]] double map_loss(const MapLoss& form, const std::vector<float>& target,
                              const std::vector<float>& output, Shape shape,
                              std::vector<float>& derivative);

}  // namespace tarsier::linalg
