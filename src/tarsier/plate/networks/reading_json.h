// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"

#include <nlohmann/json_fwd.hpp>

namespace tarsier::plate {

// {"text", "confidence", "country", "rows", "box": [x, y, w, h], "corners": [[x, y] * 4],
//  "characters": [{"text", "confidence", "corners"}], "candidates": [{"text", "confidence",
// "country"}]}; confidences are rounded to four decimals, coordinates to a tenth of a pixel.
[[nodiscard]] nlohmann::ordered_json reading_json(const Reading& reading);

}  // namespace tarsier::plate
