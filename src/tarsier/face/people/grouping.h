// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/sighting_groups.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>
#include <stop_token>

// Groups the unknown sightings of a gallery.
namespace tarsier::face::people {

struct GroupingReport {
  std::int64_t assigned = 0;    // sightings
  std::int64_t new_groups = 0;  // new groups that still exist
  std::int64_t merged = 0;      // groups that were merged into another one
  std::int64_t groups = 0;      // current number of groups
  double threshold = 0;         // current threshold for the score of two groups in the first pass
};

// Places the ungrouped sightings in their order, in batches. Placed sightings survive an
// interruption, and a later call continues with the same result. Classic templates are grouped in
// two passes if options.false_merges is 0 and there are at least 60 sightings. The first pass uses
// kFirstPassFalseMergeRate. The second pass merges groups of the same person (find_group_merges(),
// repeated until nothing changes). `background` must have directions. Sightings that were placed
// with another background (classic, deep) are compared with this one from now on. Throws
// std::invalid_argument, OutputError, Interrupted.
[[nodiscard]] GroupingReport group_sightings(Gallery& gallery,
                                             const recognition::Background& background,
                                             const GroupingOptions& options, Progress& progress,
                                             const std::stop_token& stop);

// The same in pieces, for callers that must not block. The gallery and the background must outlive
// the object.
class SightingGrouping {
 public:
  // Throws std::invalid_argument, also for the background.
  SightingGrouping(Gallery& gallery, const recognition::Background& background,
                   const GroupingOptions& options);
  ~SightingGrouping();
  SightingGrouping(SightingGrouping&&) noexcept;
  SightingGrouping& operator=(SightingGrouping&&) noexcept;
  // Places up to `max_sightings` sightings, or makes a round of merges. False: nothing is left to
  // do. The groups do not depend on `max_sightings`. Throws as group_sightings().
  bool step(const std::stop_token& stop, int max_sightings = 64);
  [[nodiscard]] std::int64_t pending() const;  // sightings that are not placed yet
  // The report so far; `new_groups` and `groups` are set when nothing is left to do.
  [[nodiscard]] const GroupingReport& report() const;

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

// Finds the most similar group of unknown faces for a face that is not placed itself.
class GroupFinder {
 public:
  // Both must outlive the object. Throws std::invalid_argument for a background without directions.
  GroupFinder(Gallery& gallery, const recognition::Background& background);
  ~GroupFinder();
  GroupFinder(GroupFinder&&) noexcept;
  GroupFinder& operator=(GroupFinder&&) noexcept;
  // Call when the groups changed: they are read again on the next find().
  void invalidate();
  // `crop`: CV_8UC1, as from crop_face(); `quality` 0..1. Returns 0 if no group is similar enough.
  [[nodiscard]] std::int64_t find(const cv::Mat& crop, double quality, const std::stop_token& stop);

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

}  // namespace tarsier::face::people
