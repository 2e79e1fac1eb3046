// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

namespace tarsier::test_support {

// The status of a live source.
inline SourceStatus live(double age_s = 0.02) {
  SourceStatus status;
  status.state = SourceState::kLive;
  status.age_s = age_s;
  return status;
}

}  // namespace tarsier::test_support
