// SPDX-License-Identifier: MIT
#pragma once

#include <numbers>

namespace tarsier::synth {

inline constexpr double kTurn = 2 * std::numbers::pi;  // rad

}  // namespace tarsier::synth
