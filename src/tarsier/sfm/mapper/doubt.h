// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>

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

// Whether and why the pixels of two images speak against their pair (patch_evidence.h).
struct PatchDoubt {
  std::string reason;           // empty: nothing does
  bool patches_differ = false;  // else few could be compared, where there is a reason

  [[nodiscard]] explicit operator bool() const { return !reason.empty(); }
  friend bool operator==(const PatchDoubt&, const PatchDoubt&) = default;
};

}  // namespace tarsier::sfm
