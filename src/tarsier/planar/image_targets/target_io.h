// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/target.h"

#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::planar::image_targets {

// Writes an Archive "image-target" of about 1 MB: the grey image, its features and its rating.
// `provenance`: an object that describes the training. Throws OutputError.
void write_target(const std::string& path, const Target& target,
                  const nlohmann::json& provenance = nlohmann::json::object());

// Checks all sizes, positions and numbers. Throws ModelError, which names the path and the fault.
[[nodiscard]] Target read_target(const std::string& path);

}  // namespace tarsier::planar::image_targets
