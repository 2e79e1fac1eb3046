// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/gallery.h"

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>

namespace tarsier::face::people {

struct ExportReport {
  std::int64_t people = 0;
  std::int64_t faces = 0;
};

// Writes everything that a gallery holds of its people into a folder: person-1/face-1.png .. (named
// by numbers: names may hold anything), faces.lst (`path<TAB>name`, for `people train --list
// faces.lst --raw`), seen/sighting-1.png .. and people.json (names, notes, times, sources, quality;
// who was seen, the unknown by their groups). `time_text` writes
// moments. Throws OutputError where the folder exists and is not empty, Interrupted.
ExportReport export_gallery(Gallery& gallery, const std::string& folder,
                            const std::function<std::string(std::int64_t)>& time_text,
                            const std::stop_token& stop);

}  // namespace tarsier::face::people
