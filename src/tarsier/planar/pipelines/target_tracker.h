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
  image_targets::TrackOptions track;  // stills use only its `detect`
  // Width 0 means any image size. Without a camera there are no poses.
  std::optional<geometry::Camera> camera;
  void check() const;  // throws std::invalid_argument that names the value
};

// The targets of one frame.
struct TargetResult {
  std::vector<image_targets::TrackedTarget> tracked;  // in the order of `targets`
  // All targets that were searched. Never null in a result of process().
  std::shared_ptr<const std::vector<image_targets::Target>> targets;
  std::optional<geometry::Camera> camera;  // the camera of the poses, scaled to images of this size
  double ms = 0;                           // time spent finding the targets, milliseconds

  [[nodiscard]] const image_targets::Target& target_of(
      const image_targets::TrackedTarget& one) const {
    return targets->at(one.target);
  }
};

// {"markers": [image_targets::target_json()..], "ms"}: a line of `tarsier ar target-track --json`,
// without the image name.
[[nodiscard]] nlohmann::ordered_json to_json(const TargetResult& result);

// State carried from frame to frame of a video. Use one state for each stream of frames, always
// with the same tracker.
struct TargetState {
  image_targets::TrackState track;
  std::string source;  // source of the frames
};

// Finds trained targets (see image_targets/train.h) in images, and tracks them in videos:
//
//   const auto tracker = planar::TargetTracker::load({"cover.target.json"});
//   planar::TargetState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {})) {
//     const planar::TargetResult result = tracker.process(*frame, state);
//     for (const auto& seen : result.tracked)
//       fmt::print("{} at {:.0f} {:.0f}\n", result.target_of(seen).name, seen.corners[0].x,
//                  seen.corners[0].y);
//   }
//
// The object is const, and copies share the targets. Any number of threads may use it, each with
// its own state.
class TargetTracker {
 public:
  // Loads files of image_targets::write_target(). The targets are numbered from 0. Throws
  // ModelError, which names the file, and std::invalid_argument (bad options).
  [[nodiscard]] static TargetTracker load(const std::vector<std::string>& paths,
                                          const TargetTrackerOptions& options = {});
  // Uses targets that are already in memory.
  explicit TargetTracker(std::vector<image_targets::Target> targets,
                         const TargetTrackerOptions& options = {});

  [[nodiscard]] const std::vector<image_targets::Target>& targets() const { return *targets_; }
  [[nodiscard]] const TargetTrackerOptions& options() const { return options_; }

  // `frame.image` is CV_8UC3 (BGR) or CV_8UC1. A still is searched on its own. In a video the
  // targets are tracked until another source begins. `debug` may be null; it receives the stages.
  // Throws InputError if the camera's images have another aspect ratio.
  [[nodiscard]] TargetResult process(const Frame& frame, TargetState& state,
                                     DebugSink* debug = nullptr) const;

 private:
  std::shared_ptr<const std::vector<image_targets::Target>> targets_;
  TargetTrackerOptions options_;
};

// Discards all tracked positions: the next frame is searched for all targets.
void redetect(TargetState& state);

}  // namespace tarsier::planar
