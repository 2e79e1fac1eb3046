// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/gallery.h"

#include <cstdint>
#include <optional>

namespace tarsier::face::people {

// Deletes sightings older than `keep_ms` while a program runs: at its start and then every hour, a
// few hundred at a time, so that no frame is delayed for long.
class SightingRetention {
 public:
  // The gallery must outlive it. keep_ms > 0.
  SightingRetention(Gallery& gallery, std::int64_t keep_ms);
  // Call with every frame; `now` in ms since 1970-01-01 UTC. Returns the number of deleted
  // sightings.
  std::int64_t step(std::int64_t now);

 private:
  Gallery& gallery_;
  std::int64_t keep_ms_;
  std::optional<std::int64_t> last_;  // time of the last run
  bool has_more_ = false;             // the last run has left some sightings
};

}  // namespace tarsier::face::people
