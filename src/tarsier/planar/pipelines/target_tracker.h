// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/media/frame.h"
#include "tarsier/planar/image_targets/track.h"

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::planar {

struct TargetTrackerOptions {
  image_targets::TrackOptions track;       // of stills its `detect`
  std::optional<geometry::Camera> camera;  // width 0: of any size. Without one there are no poses
  void check() const;                      // throws std::invalid_argument that names the value
};

// The targets of one frame.
struct TargetResult {
  std::vector<image_targets::TrackedTarget> seen;  // in the order of `targets`
  // All that were searched; never null in a result of process().
  std::shared_ptr<const std::vector<image_targets::Target>> targets;
  std::optional<geometry::Camera> camera;  // that the poses are in, for images of this size
  double ms = 0;                           // spent to find them, milliseconds

  [[nodiscard]] const image_targets::Target& target_of(
      const image_targets::TrackedTarget& one) const {
    return targets->at(one.target);
  }
};

// {"markers": [image_targets::target_json()..], "ms"}: the line of `tarsier ar target-track --json`
// without the image's name.
[[nodiscard]] nlohmann::ordered_json to_json(const TargetResult& result);

// What is known from earlier frames of a video: one for each stream of frames, always of the same
// tracker.
struct TargetState {
  image_targets::TrackState track;
  std::string source;  // that the frames are from
};

// Finds trained images (see image_targets/train.h) in images, and tracks them in videos:
//
//   const auto tracker = planar::TargetTracker::load({"cover.target.json"});
//   planar::TargetState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {})) {
//     const planar::TargetResult result = tracker.process(*frame, state);
//     for (const auto& seen : result.seen)
//       fmt::print("{} at {:.0f} {:.0f}\n", result.target_of(seen).name, seen.corners[0].x,
//                  seen.corners[0].y);
//   }
//
// Const: copies share the targets, and any number of threads may use it, each with a state of its
// own.
class TargetTracker {
 public:
  // Of files that image_targets::write_target() wrote; numbered from 0. Throws ModelError naming
  // the file, std::invalid_argument (options).
  [[nodiscard]] static TargetTracker load(const std::vector<std::string>& paths,
                                          const TargetTrackerOptions& options = {});
  // Of targets that are there already.
  explicit TargetTracker(std::vector<image_targets::Target> targets,
                         const TargetTrackerOptions& options = {});

  [[nodiscard]] const std::vector<image_targets::Target>& targets() const { return *targets_; }
  [[nodiscard]] const TargetTrackerOptions& options() const { return options_; }

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. The targets of a still are found for themselves; those
  // of a video are tracked until another source begins. `debug`, which may be null, takes the
  // stages. Throws InputError where the camera is that of images of another shape.
  [[nodiscard]] TargetResult process(const Frame& frame, TargetState& state,
                                     DebugSink* debug = nullptr) const;

 private:
  std::shared_ptr<const std::vector<image_targets::Target>> targets_;
  TargetTrackerOptions options_;
};

// Forgets all places: the next frame is searched for all targets.
void redetect(TargetState& state);

}  // namespace tarsier::planar
