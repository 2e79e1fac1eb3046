// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/target.h"

#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::planar::image_targets {

// An Archive "image-target" of about 1 MB: the grey image, its features and its rating.
// `provenance`: an object, from what and how it was trained. Throws OutputError.
void write_target(const std::string& path, const Target& target,
                  const nlohmann::json& provenance = nlohmann::json::object());

// Checks all sizes, places and numbers. Throws ModelError naming the path and what is wrong.
[[nodiscard]] Target read_target(const std::string& path);

}  // namespace tarsier::planar::image_targets
