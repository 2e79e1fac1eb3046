// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/still_source.h"  // source_of()

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace tarsier {

// An object that appeared or was lost.
struct PresenceChange {
  std::int64_t id = 0;
  bool appeared = true;  // else lost
  std::string source;
  double first_time = 0;  // s, time of the frames
  double last_time = 0;   // when it was last seen
};

// Converts the objects seen in each frame to appearances and losses. An object is lost only after
// `lost_after` seconds without it.
class Presence {
 public:
  // Throws std::invalid_argument for a negative or infinite time.
  explicit Presence(double lost_after = 1);

  // Processes one frame; ids may repeat. If the source changes or its time decreases, all earlier
  // objects are lost.
  [[nodiscard]] std::vector<PresenceChange> step(const std::string& source, double time,
                                                 const std::vector<std::int64_t>& ids);
  // No more frames: all objects are lost.
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
