// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/tracking/time_text.h"

#include <string>

namespace tarsier::plate {

inline Moment moment_at(const std::string& text) { return parse_moment(text, {}, false, "time"); }

}  // namespace tarsier::plate
