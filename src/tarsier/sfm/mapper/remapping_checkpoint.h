// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/mapper.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// One checkpoint for images that are mapped, and then mapped again several times from their
// strongest pairs (strong_pairs.h): MapperState::patch_doubts and MapperState::tries. Supplies each
// mapping with the hooks that read and write its part.
class RemappingCheckpoint {
 public:
  // `hooks` are those of the caller and must outlive this object. A state that does not fit the
  // input, or whose first mapping is not finished, has no tries.
  RemappingCheckpoint(const MapperInput& input, const MapperHooks& hooks);

  // Hooks of the first mapping. This object must outlive them, also those of next_try().
  [[nodiscard]] MapperHooks first();
  // Hooks of the next repeated mapping.
  [[nodiscard]] MapperHooks next_try();

  // Empty where they are not known yet.
  [[nodiscard]] const std::vector<PatchDoubt>& patch_doubts() const { return patch_doubts_; }
  void keep_patch_doubts(std::vector<PatchDoubt> doubts);

 private:
  void keep();

  const MapperHooks& hooks_;
  MapperState first_;  // without the members below
  std::vector<PatchDoubt> patch_doubts_;
  std::vector<MapperState> tries_;
  std::size_t tried_ = 0;
};

}  // namespace tarsier::sfm
