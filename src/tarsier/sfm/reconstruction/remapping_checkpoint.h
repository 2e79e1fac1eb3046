// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/mapper_hooks.h"
#include "tarsier/sfm/mapper/mapper_input.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// One checkpoint for images that are mapped, and then mapped again several times from their
// strongest pairs (strong_pairs.h): MapperState::patch_rejections and MapperState::attempts.
// Supplies each mapping with the hooks that read and write its part.
class RemappingCheckpoint {
 public:
  // `hooks` are those of the caller and must outlive this object. A state that does not fit the
  // input, or whose first mapping is not finished, has no attempts.
  RemappingCheckpoint(const MapperInput& input, const MapperHooks& hooks);

  // Hooks of the first mapping. This object must outlive them, also those of next_attempt().
  [[nodiscard]] MapperHooks first();
  // Hooks of the next repeated mapping.
  [[nodiscard]] MapperHooks next_attempt();

  // Empty where they are not known yet.
  [[nodiscard]] const std::vector<PatchRejection>& patch_rejections() const {
    return patch_rejections_;
  }
  void save_patch_rejections(std::vector<PatchRejection> rejections);

 private:
  void save();

  const MapperHooks& hooks_;
  MapperState first_;  // without the members below
  std::vector<PatchRejection> patch_rejections_;
  std::vector<MapperState> attempts_;
  std::size_t next_index_ = 0;
};

}  // namespace tarsier::sfm
