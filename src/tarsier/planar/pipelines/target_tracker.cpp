// SPDX-License-Identifier: MIT
#include "tarsier/planar/pipelines/target_tracker.h"

#include "tarsier/core/require.h"
#include "tarsier/geometry/frame_camera.h"
#include "tarsier/media/still_source.h"
#include "tarsier/planar/image_targets/evaluate.h"
#include "tarsier/planar/image_targets/target_io.h"

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::planar {

void TargetTrackerOptions::check() const { track.check(); }

nlohmann::ordered_json to_json(const TargetResult& result) {
  auto list = nlohmann::ordered_json::array();
  for (const image_targets::TrackedTarget& one : result.tracked)
    list.push_back(image_targets::target_json(result.target_of(one), one.target, one.homography,
                                              one.corners, one.confidence,
                                              one.pose ? &*one.pose : nullptr));
  return {{"markers", std::move(list)}, {"ms", std::round(result.ms * 100) / 100}};
}

TargetTracker::TargetTracker(std::vector<image_targets::Target> targets,
                             const TargetTrackerOptions& options)
    : targets_(std::make_shared<const std::vector<image_targets::Target>>(std::move(targets))),
      options_(options) {
  options.check();
}

TargetTracker TargetTracker::load(const std::vector<std::string>& paths,
                                  const TargetTrackerOptions& options) {
  options.check();
  std::vector<image_targets::Target> targets;
  targets.reserve(paths.size());
  for (const std::string& path : paths) targets.push_back(image_targets::read_target(path));
  return TargetTracker(std::move(targets), options);
}

TargetResult TargetTracker::process(const Frame& frame, TargetState& state,
                                    DebugSink* debug) const {
  TARSIER_REQUIRE(!frame.image.empty(), "an image without pixels");
  const std::string source = source_of(frame);
  if (frame.still || source != state.source) redetect(state);
  state.source = source;
  TargetResult result;
  result.targets = targets_;
  if (options_.camera) result.camera = geometry::camera_of_frame(*options_.camera, frame);
  const auto start = std::chrono::steady_clock::now();
  result.tracked = image_targets::track(*targets_, options_.track, state.track, frame.image,
                                        result.camera ? &*result.camera : nullptr, debug);
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - start;
  result.ms = spent.count();
  return result;
}

void redetect(TargetState& state) { state.track = {}; }

}  // namespace tarsier::planar
