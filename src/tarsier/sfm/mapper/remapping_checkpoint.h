// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/mapper.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// The one checkpoint of images that are mapped and then, from their strongest pairs (strong_pairs.h), mapped again several
// times: MapperState::patch_doubts and MapperState::tries. Gives each mapping the hooks that read and write its part.
class RemappingCheckpoint {
 public:
  // `hooks` are those of the caller, and must outlive this. A state that does not fit the input, or is not of a finished
  // first mapping, has no tries.
  RemappingCheckpoint(const MapperInput& input, const MapperHooks& hooks);

  // Of the first mapping. This must outlive them, also those of next_try().
  [[nodiscard]] MapperHooks first();
  // Of the next mapping again.
  [[nodiscard]] MapperHooks next_try();

  // Empty where there are none yet.
  [[nodiscard]] const std::vector<PatchDoubt>& patch_doubts() const { return patch_doubts_; }
  void keep_patch_doubts(std::vector<PatchDoubt> doubts);

 private:
  void keep();

  const MapperHooks& hooks_;
  MapperState first_;  // without what follows
  std::vector<PatchDoubt> patch_doubts_;
  std::vector<MapperState> tries_;
  std::size_t tried_ = 0;
};

}  // namespace tarsier::sfm
