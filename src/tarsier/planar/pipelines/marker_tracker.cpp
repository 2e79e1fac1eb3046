// SPDX-License-Identifier: MIT
#include "tarsier/planar/pipelines/marker_tracker.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rounding.h"
#include "tarsier/geometry/frame_camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/media/still_source.h"
#include "tarsier/planar/markers/predefined.h"

#include <opencv2/imgproc.hpp>

#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::planar {
namespace {

using Json = nlohmann::ordered_json;

Json rounded_list(const Eigen::Vector3d& v) {
  return {rounded_to_steps(v[0], 1e7), rounded_to_steps(v[1], 1e7), rounded_to_steps(v[2], 1e7)};
}

Json pose_json(const markers::MarkerPose& pose) {
  Json object{{"rvec", rounded_list(geometry::rotation_vector(pose.camera_from_marker.rotation))},
              {"tvec", rounded_list(pose.camera_from_marker.translation)}};
  object["errors"] = {rounded_to_steps(pose.rms_px, 1e4)};
  if (pose.other) object["errors"].push_back(rounded_to_steps(pose.other->rms_px, 1e4));
  object["ambiguity"] = rounded_to_steps(pose.ambiguity, 1e4);
  return object;
}

Json marker_json(const TrackedMarker& tracked, bool names_family) {
  Json object{{"id", tracked.marker.id}};
  if (names_family) object["family"] = tracked.family;
  object["corners"] = Json::array();
  for (const Eigen::Vector2d& p : tracked.marker.corners)
    object["corners"].push_back({rounded_to_steps(p.x(), 1e4), rounded_to_steps(p.y(), 1e4)});
  if (tracked.pose) object.update(pose_json(*tracked.pose));
  object["margin"] = rounded_to_steps(tracked.marker.margin, 1e4);
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
  if (board) {
    board->check();
    TARSIER_REQUIRE(families == std::vector{board->family}, "a board of {} with other families",
                    board->family);
  }
  detect.check();
  track.check();
}

nlohmann::ordered_json to_json(const MarkerResult& result) {
  Json list = Json::array();
  for (const TrackedMarker& tracked : result.markers)
    list.push_back(marker_json(tracked, result.names_families));
  Json line{{"markers", std::move(list)}};
  if (result.board) {
    line["board"] = {{"markers", result.board_markers}};
    line["board"].update(pose_json(*result.board));
  }
  line["ms"] = rounded_to_steps(result.ms, 100);
  return line;
}

MarkerTracker::MarkerTracker(const MarkerTrackerOptions& options) : options_(options) {
  options.check();
  for (const std::string& family : options.families)
    families_.push_back(&markers::find_dictionary(family));
}

MarkerTracker MarkerTracker::load(const MarkerTrackerOptions& options) {
  return MarkerTracker(options);
}

void MarkerTracker::locate_board(const std::vector<markers::Marker>& found, const Frame& frame,
                                 MarkerState& state, MarkerResult& result) const {
  const std::vector<markers::BoardMarker>& board = options_.board->markers;
  result.board_markers = static_cast<int>(markers::corners_on_board(found, board).ids.size());
  result.board = frame.still ? markers::pose_of_board(found, board, result.camera)
                             : markers::track_board(found, board, result.camera, frame.time,
                                                    options_.track, state.board);
}

MarkerResult MarkerTracker::process(const Frame& frame, MarkerState& state,
                                    DebugSink* debug) const {
  const cv::Mat& image = frame.image;
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "an image of type {}", image.type());
  const std::string source = source_of(frame);
  if (frame.still || source != state.source) {
    state.tracks.clear();
    state.board = {};
  }
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
    if (options_.board) locate_board(found, frame, state, result);
    if (options_.side <= 0 || options_.board) {
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
