// SPDX-License-Identifier: MIT
#include "tarsier/plate/site/fair_scheduler.h"

#include "tarsier/core/require.h"

#include <algorithm>

namespace tarsier::plate {

FairScheduler::FairScheduler(std::size_t cameras) : cameras_(cameras) {}

void FairScheduler::offer(std::size_t camera, bool low_priority) {
  Camera& state = cameras_.at(camera);
  if (!state.has_request && !state.is_served) state.clock_s = std::max(state.clock_s, now_s_);
  state.is_low_priority = low_priority && (!state.has_request || state.is_low_priority);
  state.has_request = true;
}

std::optional<std::size_t> FairScheduler::take() {
  const auto goes_before = [](const Camera& a, const Camera& b) {
    return a.is_low_priority != b.is_low_priority ? b.is_low_priority : a.clock_s < b.clock_s;
  };
  std::optional<std::size_t> next;
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    const Camera& state = cameras_[i];
    if (!state.has_request || state.is_served) continue;
    if (!next || goes_before(state, cameras_[*next])) next = i;
  }
  if (!next) return next;
  Camera& selected = cameras_[*next];
  selected.has_request = false;
  selected.is_served = true;
  now_s_ = std::max(now_s_, selected.clock_s);
  return next;
}

void FairScheduler::done(std::size_t camera, double cost_s) {
  Camera& state = cameras_.at(camera);
  TARSIER_REQUIRE(state.is_served, "the camera is being served");
  state.is_served = false;
  state.clock_s += cost_s;
}

}  // namespace tarsier::plate
