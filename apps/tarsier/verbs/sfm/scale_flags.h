// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/placement.h"

#include "framework/command.h"
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// Flags that determine the unit of a model: the distance of two cameras, or markers of known size.
struct ScaleFlags {
  double distance = 0;
  std::vector<std::string> distance_between;
  std::string marker_size;
  std::string marker_family = "36h11";
};

void add_scale_flags(Command& verb, ScaleFlags& flags, std::string_view group);

// Sets the options from the flags. Throws UsageError.
void set_scale(const ScaleFlags& flags, sfm::PlacementOptions& options);

}  // namespace tarsier::cli
