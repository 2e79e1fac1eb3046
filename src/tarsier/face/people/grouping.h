// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/sighting_groups.h"
#include "tarsier/face/recognition/recognizer.h"

#include <cstdint>
#include <stop_token>

// The unknown sightings of a gallery in groups.
namespace tarsier::face::people {

struct GroupingReport {
  std::int64_t placed = 0;  // sightings
  std::int64_t made = 0;    // groups that are new, and still there
  std::int64_t merged = 0;  // groups that became part of another one
  std::int64_t groups = 0;  // there are now
  double threshold = 0;     // of the score of two groups in the first pass, now
};

// Places the sightings that are in no group yet, in their order, some at a time: what is placed
// survives an interruption, and the rest goes on from there with the same result. Of classic templates, where
// options.false_merges is 0 and there are 60 sightings, the first pass is made at kFirstPassMerges, and groups that show
// one person become one then (alike_groups(), round after round until nothing changes). `background` has
// directions; sightings that were placed by another one (classic, deep) are compared by this one
// from now on. Throws std::invalid_argument, OutputError, Interrupted.
[[nodiscard]] GroupingReport group_sightings(Gallery& gallery,
                                             const recognition::Background& background,
                                             const GroupingOptions& options, Progress& progress,
                                             const std::stop_token& stop);

}  // namespace tarsier::face::people
