// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/still_source.h"  // source_of()

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace tarsier {

// Something that came into sight, or went out of it.
struct PresenceChange {
  std::int64_t id = 0;
  bool appeared = true;  // else lost
  std::string source;
  double first_time = 0;  // s, of the frames
  double last_time = 0;   // when it was last seen
};

// Turns what is seen in each frame into what appears and what is lost. One that is missed for a
// moment is not lost: only after `lost_after` seconds without it.
class Presence {
 public:
  // Throws std::invalid_argument for a time that is negative or not finite.
  explicit Presence(double lost_after = 1);

  // One more frame; ids may come twice. Where the source changes, or its time steps back, all of
  // before is lost.
  [[nodiscard]] std::vector<PresenceChange> step(const std::string& source, double time,
                                                 const std::vector<std::int64_t>& ids);
  // No more frames: all is lost.
  [[nodiscard]] std::vector<PresenceChange> finish();

 private:
  struct Stay {
    double first_time = 0;
    double last_time = 0;
  };
  double lost_after_;
  std::string source_;
  double time_ = 0;
  std::map<std::int64_t, Stay> present_;
};

}  // namespace tarsier
