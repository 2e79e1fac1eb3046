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

// The same in pieces, for who must not wait for all of it. The gallery and the background must
// outlive it.
class SightingGrouping {
 public:
  // Throws std::invalid_argument, for the background too.
  SightingGrouping(Gallery& gallery, const recognition::Background& background,
                   const GroupingOptions& options);
  ~SightingGrouping();
  SightingGrouping(SightingGrouping&&) noexcept;
  SightingGrouping& operator=(SightingGrouping&&) noexcept;
  // Places up to `most` sightings, or makes a round of merges. False: nothing is left to do. The
  // groups are the same whatever `most` is. Throws as group_sightings().
  bool step(const std::stop_token& stop, int most = 64);
  [[nodiscard]] std::int64_t waiting() const;  // sightings, now
  // So far; `made` and `groups` when nothing is left to do.
  [[nodiscard]] const GroupingReport& report() const;

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

// Which group of unknown faces a face is like that was not placed, or never will be.
class GroupFinder {
 public:
  // Both must outlive it. Throws std::invalid_argument for a background without directions.
  GroupFinder(Gallery& gallery, const recognition::Background& background);
  ~GroupFinder();
  GroupFinder(GroupFinder&&) noexcept;
  GroupFinder& operator=(GroupFinder&&) noexcept;
  // The groups are read again when next asked for: they changed.
  void reread();
  // `crop`: CV_8UC1, as cut_face() makes it; `quality` 0..1. 0: it is like no group enough to join it.
  [[nodiscard]] std::int64_t find(const cv::Mat& crop, double quality, const std::stop_token& stop);

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

}  // namespace tarsier::face::people
