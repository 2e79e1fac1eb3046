// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>

namespace tarsier::sfm {

// The objection to a verified pair. From kEvidence on the pair is not used.
enum class Doubt : std::uint8_t {
  kNone = 0,
  kBadStart = 1,  // a model cannot start with it
  kEvidence = 2,  // it lacks features that both images should have (repeated_structure.h)
  kCycles = 3,    // no cycle of three pairs that contains it closes (global_start.h)
  kRotation = 4,  // its rotation contradicts that of the other pairs (global_start.h)
  kModel = 5,     // a model with it superimposes different places (model_conflicts.h)
};
[[nodiscard]] constexpr bool is_refused(Doubt doubt) { return doubt > Doubt::kBadStart; }

// The objection of the pixels of two images to their pair (patch_evidence.h).
struct PatchDoubt {
  std::string reason;           // empty: no objection
  bool patches_differ = false;  // false with a reason: too few patches could be compared

  [[nodiscard]] explicit operator bool() const { return !reason.empty(); }
  friend bool operator==(const PatchDoubt&, const PatchDoubt&) = default;
};

}  // namespace tarsier::sfm
