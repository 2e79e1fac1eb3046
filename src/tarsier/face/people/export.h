// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/gallery.h"

#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>

namespace tarsier::face::people {

struct ExportReport {
  std::int64_t people = 0;
  std::int64_t faces = 0;
};

// Writes all data of a gallery into a folder: person-1/face-1.png .. (numbered, because names may
// contain any character), faces.lst (`path<TAB>name`, for `people train --list faces.lst --raw`),
// seen/sighting-1.png .., negatives/negative-1.png .. and people.json (names, notes, times,
// sources, quality; the sightings, unknown ones by group; the negatives; the log of corrections).
// `time_text` formats times. Throws OutputError if the folder exists and is not empty, Interrupted.
ExportReport export_gallery(Gallery& gallery, const std::string& folder,
                            const std::function<std::string(std::int64_t)>& time_text,
                            const std::stop_token& stop);

// {"correction", "time", "who", "what", "from", "to", "count", "undone", "undoes"}
[[nodiscard]] nlohmann::ordered_json to_json(
    const Correction& entry, const std::function<std::string(std::int64_t)>& time_text);

}  // namespace tarsier::face::people
