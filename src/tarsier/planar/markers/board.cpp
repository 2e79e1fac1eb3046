// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/board.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/markers/predefined.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <utility>

namespace tarsier::planar::markers {
namespace {

constexpr double kMaxLength = 1000;  // m

BoardMarker marker_of(const nlohmann::json& json) {
  BoardMarker marker;
  marker.id = json.at("id").get<int>();
  marker.center = {json.at("center").at(0).get<double>(), json.at("center").at(1).get<double>()};
  marker.size = json.at("size").get<double>();
  marker.rotation = json.value("rotation", 0.0) * kRadiansPerDegree;
  return marker;
}

// Why a board is invalid; empty if it is not. Throws UsageError for an unknown family.
std::string problem_of(const MarkerBoard& board) {
  const int known = find_dictionary(board.family).size();
  if (board.markers.empty()) return "a board without markers";
  std::set<int> ids;
  for (const BoardMarker& marker : board.markers) {
    if (marker.id < 0 || marker.id >= known)
      return fmt::format("{} has no marker {}", board.family, marker.id);
    if (!ids.insert(marker.id).second)
      return fmt::format("the marker {} is on the board twice", marker.id);
    if (!(marker.size > 0 && marker.size <= kMaxLength))
      return fmt::format("the marker {} is {} m wide", marker.id, marker.size);
    const bool is_near =
        std::abs(marker.center.x) <= kMaxLength && std::abs(marker.center.y) <= kMaxLength;
    if (!is_near || !std::isfinite(marker.rotation)) {
      return fmt::format("the marker {} is at ({}, {}) m", marker.id, marker.center.x,
                         marker.center.y);
    }
  }
  return "";
}

}  // namespace

void MarkerBoard::check() const {
  const std::string problem = problem_of(*this);
  TARSIER_REQUIRE(problem.empty(), "{}", problem);
}

MarkerBoard parse_marker_board(const std::string& text, const std::string& name) {
  const nlohmann::json json = parse_json(text, name);
  MarkerBoard board;
  try {
    board.family = json.at("family").get<std::string>();
    for (const nlohmann::json& marker : json.at("markers"))
      board.markers.push_back(marker_of(marker));
    if (const std::string problem = problem_of(board); !problem.empty())
      throw InputError(name, problem);
  } catch (const nlohmann::json::exception&) {
    throw InputError(name,
                     "is not a board of markers: expected \"family\", and \"markers\" with "
                     "\"id\", \"center\" and \"size\"");
  } catch (const UsageError& error) {  // the family
    throw InputError(name, error.what());
  }
  return board;
}

MarkerBoard read_marker_board(const std::string& path) {
  return parse_marker_board(read_file(path, 10'000'000), path);
}

void write_marker_board(const std::string& path, const MarkerBoard& board) {
  board.check();
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const BoardMarker& marker : board.markers) {
    nlohmann::ordered_json item{
        {"id", marker.id}, {"center", {marker.center.x, marker.center.y}}, {"size", marker.size}};
    if (marker.rotation != 0) item["rotation"] = marker.rotation * kDegreesPerRadian;
    list.push_back(std::move(item));
  }
  const nlohmann::ordered_json json{{"family", board.family}, {"markers", std::move(list)}};
  write_file_atomically(path, json.dump(2) + "\n");
}

BoardCorners corners_on_board(std::span<const Marker> markers, std::span<const BoardMarker> board) {
  BoardCorners corners;
  for (const Marker& marker : markers) {
    const auto place = std::find_if(board.begin(), board.end(),
                                    [&](const BoardMarker& b) { return b.id == marker.id; });
    if (place == board.end()) continue;
    corners.ids.push_back(marker.id);
    const double c = std::cos(place->rotation);
    const double s = std::sin(place->rotation);
    for (const cv::Point2d& p : corners_on_marker(place->size))
      corners.on_board.push_back(place->center + cv::Point2d(c * p.x - s * p.y, s * p.x + c * p.y));
    for (const Eigen::Vector2d& corner : marker.corners)
      corners.pixels.emplace_back(corner.x(), corner.y());
  }
  return corners;
}

std::optional<MarkerPose> pose_of_board(std::span<const Marker> markers,
                                        std::span<const BoardMarker> board,
                                        const geometry::Camera& camera) {
  const BoardCorners corners = corners_on_board(markers, board);
  if (corners.ids.empty()) return std::nullopt;
  const auto poses = geometry::planar_poses(corners.on_board, corners.pixels, camera);
  if (!poses) return std::nullopt;
  return MarkerPose{poses->best.camera_from_plane, poses->best.rms_px, poses->other,
                    ambiguity_of(poses->best, poses->other)};
}

std::optional<MarkerPose> track_board(std::span<const Marker> markers,
                                      std::span<const BoardMarker> board,
                                      const geometry::Camera& camera, double time,
                                      const geometry::PlanarTrackOptions& options,
                                      BoardTrack& track) {
  BoardCorners corners = corners_on_board(markers, board);
  if (corners.ids.empty()) return std::nullopt;
  if (corners.ids != track.ids) track = {std::move(corners.ids), {}};
  const auto tracked =
      geometry::track_plane(corners.on_board, corners.pixels, camera, time, options, track.state);
  if (!tracked) return std::nullopt;
  return MarkerPose{tracked->steady, tracked->pose.rms_px, tracked->other,
                    ambiguity_of(tracked->pose, tracked->other)};
}

}  // namespace tarsier::planar::markers
