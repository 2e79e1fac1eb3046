// SPDX-License-Identifier: MIT
#include "ui/face/presence.h"

#include "tarsier/core/require.h"

#include <cmath>
#include <iterator>
#include <utility>

namespace tarsier {

Presence::Presence(double lost_after) : lost_after_(lost_after) {
  TARSIER_REQUIRE(std::isfinite(lost_after) && lost_after >= 0, "lost after {} s", lost_after);
}

std::vector<PresenceChange> Presence::step(const std::string& source, double time,
                                           const std::vector<std::int64_t>& ids) {
  std::vector<PresenceChange> changes;
  if (source != source_ || time < time_) changes = finish();
  source_ = source;
  time_ = time;
  for (const std::int64_t id : ids) {
    const auto [stay, is_new] = present_.try_emplace(id, Stay{time, time});
    stay->second.last_time = time;
    if (is_new) changes.push_back({id, true, source_, time, time});
  }
  for (auto stay = present_.begin(); stay != present_.end();) {
    if (time - stay->second.last_time <= lost_after_) {
      ++stay;
      continue;
    }
    changes.push_back(
        {stay->first, false, source_, stay->second.first_time, stay->second.last_time});
    stay = present_.erase(stay);
  }
  return changes;
}

std::vector<PresenceChange> Presence::finish() {
  std::vector<PresenceChange> changes;
  for (const auto& [id, stay] : present_)
    changes.push_back({id, false, source_, stay.first_time, stay.last_time});
  present_.clear();
  return changes;
}

}  // namespace tarsier
