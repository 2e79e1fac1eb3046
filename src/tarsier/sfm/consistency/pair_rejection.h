// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>

namespace tarsier::sfm {

// Why a verified pair is rejected. From kMissingFeatures on the pair is not used.
enum class PairRejection : std::uint8_t {
  kNone = 0,
  kBadInitialPair = 1,   // a model cannot start with it
  kMissingFeatures = 2,  // it lacks features that both images should have (repeated_structure.h)
  kOpenCycles = 3,       // no cycle of three pairs that contains it closes (global_start.h)
  kRotationError = 4,    // its rotation contradicts that of the other pairs (global_start.h)
  kModelConflict = 5,    // a model with it superimposes different places (model_conflicts.h)
};
[[nodiscard]] constexpr bool is_refused(PairRejection rejection) {
  return rejection > PairRejection::kBadInitialPair;
}

// Why the pixels of two images reject their pair (patch_evidence.h).
struct PatchRejection {
  std::string reason;           // empty: not rejected
  bool patches_differ = false;  // false with a reason: too few patches could be compared

  [[nodiscard]] explicit operator bool() const { return !reason.empty(); }
  friend bool operator==(const PatchRejection&, const PatchRejection&) = default;
};

}  // namespace tarsier::sfm
