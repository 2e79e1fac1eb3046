// SPDX-License-Identifier: MIT
#include "tarsier/plate/site/fair_scheduler.h"

#include "tarsier/core/require.h"

#include <algorithm>

namespace tarsier::plate {

FairScheduler::FairScheduler(std::size_t cameras) : cameras_(cameras) {}

void FairScheduler::offer(std::size_t camera, bool spare) {
  Camera& one = cameras_.at(camera);
  if (!one.waits && !one.is_served) one.clock_s = std::max(one.clock_s, now_s_);
  one.is_spare = spare && (!one.waits || one.is_spare);
  one.waits = true;
}

std::optional<std::size_t> FairScheduler::take() {
  const auto goes_before = [](const Camera& a, const Camera& b) {
    return a.is_spare != b.is_spare ? b.is_spare : a.clock_s < b.clock_s;
  };
  std::optional<std::size_t> next;
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    const Camera& one = cameras_[i];
    if (!one.waits || one.is_served) continue;
    if (!next || goes_before(one, cameras_[*next])) next = i;
  }
  if (!next) return next;
  Camera& taken = cameras_[*next];
  taken.waits = false;
  taken.is_served = true;
  now_s_ = std::max(now_s_, taken.clock_s);
  return next;
}

void FairScheduler::done(std::size_t camera, double cost_s) {
  Camera& one = cameras_.at(camera);
  TARSIER_REQUIRE(one.is_served, "the camera is being served");
  one.is_served = false;
  one.clock_s += cost_s;
}

}  // namespace tarsier::plate
