// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace tarsier::sfm {

// What is said against a verified pair. From kEvidence on it is not used.
enum class Doubt : std::uint8_t {
  kNone = 0,
  kBadStart = 1,  // no model can begin with it
  kEvidence = 2,  // it lacks what the two should have in common (repeated_structure.h)
  kCycles = 3,    // no cycle of three pairs that it is in closes (global_start.h)
  kRotation = 4,  // its rotation contradicts that of all others (global_start.h)
  kModel = 5,     // a model with it lays different places over each other (model_conflicts.h)
};
[[nodiscard]] constexpr bool is_refused(Doubt doubt) { return doubt > Doubt::kBadStart; }

}  // namespace tarsier::sfm
