// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/gallery.h"

#include <cstdint>
#include <optional>

namespace tarsier::face::people {

// Deletes sightings that are older than `keep_ms`, for as long as a program runs: at its start and
// then each hour, a few hundred at a time, so that no frame waits for long.
class SightingRetention {
 public:
  // The gallery must outlive it. keep_ms > 0.
  SightingRetention(Gallery& gallery, std::int64_t keep_ms);
  // To be called with every frame; `now` in ms since 1970-01-01 UTC. Returns how many were deleted.
  std::int64_t step(std::int64_t now);

 private:
  Gallery& gallery_;
  std::int64_t keep_ms_;
  std::optional<std::int64_t> last_;  // when it was last looked, or began to be
  bool more_ = false;                 // some are left of that time
};

}  // namespace tarsier::face::people
