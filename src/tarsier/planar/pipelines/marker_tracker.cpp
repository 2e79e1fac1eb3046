// SPDX-License-Identifier: MIT
#include "tarsier/planar/pipelines/marker_tracker.h"

#include "tarsier/core/require.h"
#include "tarsier/geometry/frame_camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/media/still_source.h"
#include "tarsier/planar/markers/predefined.h"

#include <opencv2/imgproc.hpp>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::planar {
namespace {

using Json = nlohmann::ordered_json;

double rounded(double value, double steps) { return std::round(value * steps) / steps; }

Json list_of(const Eigen::Vector3d& v) {
  return {rounded(v[0], 1e7), rounded(v[1], 1e7), rounded(v[2], 1e7)};
}

Json marker_json(const TrackedMarker& tracked, bool names_family) {
  Json object{{"id", tracked.marker.id}};
  if (names_family) object["family"] = tracked.family;
  object["corners"] = Json::array();
  for (const Eigen::Vector2d& p : tracked.marker.corners)
    object["corners"].push_back({rounded(p.x(), 1e4), rounded(p.y(), 1e4)});
  if (tracked.pose) {
    const geometry::Rigid3& pose = tracked.pose->camera_from_marker;
    object["rvec"] = list_of(geometry::rotation_vector(pose.rotation));
    object["tvec"] = list_of(pose.translation);
    object["errors"] = {rounded(tracked.pose->rms_px, 1e4)};
    if (tracked.pose->other) object["errors"].push_back(rounded(tracked.pose->other->rms_px, 1e4));
    object["ambiguity"] = rounded(tracked.pose->ambiguity, 1e4);
  }
  object["margin"] = rounded(tracked.marker.margin, 1e4);
  return object;
}

geometry::Camera camera_for(const MarkerTrackerOptions& options, const Frame& frame) {
  if (options.camera) return geometry::camera_of_frame(*options.camera, frame);
  geometry::Camera guess = geometry::guessed_camera(frame.image.size());
  if (options.focal_px > 0) guess.fx = guess.fy = options.focal_px;
  return guess;
}

}  // namespace

void MarkerTrackerOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!families.empty(), "at least one family of markers is needed");
  for (const std::string& family : families) (void)markers::find_dictionary(family);
  detect.check();
  track.check();
}

nlohmann::ordered_json to_json(const MarkerResult& result) {
  Json list = Json::array();
  for (const TrackedMarker& tracked : result.markers)
    list.push_back(marker_json(tracked, result.names_families));
  return {{"markers", std::move(list)}, {"ms", rounded(result.ms, 100)}};
}

MarkerTracker::MarkerTracker(const MarkerTrackerOptions& options) : options_(options) {
  options.check();
  for (const std::string& family : options.families)
    families_.push_back(&markers::find_dictionary(family));
}

MarkerTracker MarkerTracker::load(const MarkerTrackerOptions& options) {
  return MarkerTracker(options);
}

MarkerResult MarkerTracker::process(const Frame& frame, MarkerState& state,
                                    DebugSink* debug) const {
  const cv::Mat& image = frame.image;
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "an image of type {}", image.type());
  const std::string source = source_of(frame);
  if (frame.still || source != state.source) state.tracks.clear();
  state.source = source;
  state.tracks.resize(families_.size());
  MarkerResult result;
  result.camera = camera_for(options_, frame);
  result.names_families = families_.size() > 1;
  const auto start = std::chrono::steady_clock::now();
  if (image.channels() == 3) cv::cvtColor(image, state.gray, cv::COLOR_BGR2GRAY);
  const cv::Mat& gray = image.channels() == 3 ? state.gray : image;
  for (std::size_t i = 0; i < families_.size(); ++i) {
    const std::string name = families_[i]->name();
    std::vector<markers::Marker> found =
        options_.detector == MarkerDetector::kOpencv
            ? markers::detect_with_opencv(gray, name)
            : markers::detect_markers(gray, *families_[i], options_.detect, state.workspace, debug);
    std::vector<markers::PosedMarker> posed;
    if (options_.side <= 0) {
      for (markers::Marker& marker : found) posed.push_back({std::move(marker), std::nullopt});
    } else if (frame.still) {
      posed = markers::pose_markers(std::move(found), options_.side, result.camera);
    } else {
      posed = markers::track_markers(std::move(found), options_.side, result.camera, frame.time,
                                     options_.track, state.tracks[i]);
    }
    for (markers::PosedMarker& one : posed)
      result.markers.push_back({name, std::move(one.marker), std::move(one.pose)});
  }
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - start;
  result.ms = spent.count();
  return result;
}

}  // namespace tarsier::planar
