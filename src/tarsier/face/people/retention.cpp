// SPDX-License-Identifier: MIT
#include "tarsier/face/people/retention.h"

#include "tarsier/core/require.h"

namespace tarsier::face::people {
namespace {

constexpr std::int64_t kInterval_ms = 3'600'000;
constexpr std::int64_t kBatchSize = 500;  // sightings

}  // namespace

SightingRetention::SightingRetention(Gallery& gallery, std::int64_t keep_ms)
    : gallery_(gallery), keep_ms_(keep_ms) {
  TARSIER_REQUIRE(keep_ms > 0, "sightings kept for {} ms", keep_ms);
}

std::int64_t SightingRetention::step(std::int64_t now) {
  // A clock that was set back starts a new hour.
  const bool due = !last_ || now < *last_ || now - *last_ >= kInterval_ms;
  if (!due && !has_more_) return 0;
  if (due) last_ = now;
  const std::int64_t removed = gallery_.forget_sightings_before(now - keep_ms_, kBatchSize);
  has_more_ = removed == kBatchSize;
  return removed;
}

}  // namespace tarsier::face::people
