// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/tracking/event.h"

#include <cstdint>
#include <string>
#include <vector>

// For the .cpp files of this module.
namespace tarsier::plate {

// The event's best crop as JPEG. Errors name `path`.
[[nodiscard]] std::vector<std::uint8_t> crop_bytes(const PlateEvent& event,
                                                   const std::string& path);

}  // namespace tarsier::plate
