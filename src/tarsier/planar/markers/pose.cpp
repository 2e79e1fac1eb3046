// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/pose.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::planar::markers {
namespace {

std::vector<cv::Point2d> pixels_of(const Quad& quad) {
  std::vector<cv::Point2d> pixels;
  for (const Eigen::Vector2d& corner : quad) pixels.emplace_back(corner.x(), corner.y());
  return pixels;
}

MarkerPose pose_of(const geometry::PlanarPoses& poses) {
  return {poses.best.camera_from_plane, poses.best.rms_px, poses.other,
          ambiguity_of(poses.best, poses.other)};
}

// The nearest track of the same id within reach that no other marker of this frame has.
PoseTracks::Track& track_of(const Marker& marker, double time,
                            std::vector<PoseTracks::Track>& tracks) {
  const Eigen::Vector2d center = center_of(marker.corners);
  const double side = (marker.corners[1] - marker.corners[0]).norm();
  PoseTracks::Track* nearest = nullptr;
  int same = 0;
  for (PoseTracks::Track& track : tracks) {
    if (track.id != marker.id) continue;
    ++same;
    if (track.is_matched) continue;
    if (nearest == nullptr || (track.center - center).norm() < (nearest->center - center).norm())
      nearest = &track;
  }
  // A single marker may move far in one frame; if there are several, each stays near.
  if (nearest != nullptr && same > 1 &&
      (nearest->center - center).norm() > 2 * std::max(side, nearest->side))
    nearest = nullptr;
  if (nearest == nullptr) {
    nearest = &tracks.emplace_back();
    nearest->id = marker.id;
  }
  nearest->center = center;
  nearest->side = side;
  nearest->time = time;
  nearest->is_matched = true;
  return *nearest;
}

}  // namespace

double ambiguity_of(const geometry::PlanarPose& pose,
                    const std::optional<geometry::PlanarPose>& other) {
  if (!other) return 0;
  const auto [less, more] = std::minmax(pose.misfit, other->misfit);
  return std::max(less, 1e-9) / std::max(more, 1e-9);
}

std::vector<cv::Point2d> corners_on_marker(double size) {
  TARSIER_REQUIRE(size > 0 && std::isfinite(size), "a marker {} m wide", size);
  const double half = size / 2;
  return {{-half, half}, {half, half}, {half, -half}, {-half, -half}};
}

std::optional<MarkerPose> pose_of_marker(const Marker& marker, double size,
                                         const geometry::Camera& camera) {
  geometry::PlanarPoseOptions options;
  options.information = marker.information;
  const auto poses =
      geometry::planar_poses(corners_on_marker(size), pixels_of(marker.corners), camera, options);
  if (!poses) return std::nullopt;
  return pose_of(*poses);
}

std::vector<PosedMarker> pose_markers(std::vector<Marker> markers, double size,
                                      const geometry::Camera& camera) {
  std::vector<PosedMarker> posed;
  for (Marker& marker : markers) {
    auto pose = pose_of_marker(marker, size, camera);
    posed.push_back({std::move(marker), std::move(pose)});
  }
  return posed;
}

std::vector<PosedMarker> track_markers(std::vector<Marker> markers, double size,
                                       const geometry::Camera& camera, double time,
                                       const geometry::PlanarTrackOptions& options,
                                       PoseTracks& tracks) {
  options.check();
  if (size != tracks.size) tracks.tracks.clear();
  tracks.size = size;
  std::erase_if(tracks.tracks, [&](const PoseTracks::Track& track) {
    return time < track.time || time - track.time > options.gap_s;
  });
  for (PoseTracks::Track& track : tracks.tracks) track.is_matched = false;
  const std::vector<cv::Point2d> corners = corners_on_marker(size);
  std::vector<PosedMarker> posed;
  for (Marker& marker : markers) {
    PoseTracks::Track& track = track_of(marker, time, tracks.tracks);
    const auto tracked = geometry::track_plane(corners, pixels_of(marker.corners), camera, time,
                                               options, track.state);
    std::optional<MarkerPose> pose;
    if (tracked) {
      pose = MarkerPose{tracked->steady, tracked->pose.rms_px, tracked->other,
                        ambiguity_of(tracked->pose, tracked->other)};
    }
    posed.push_back({std::move(marker), std::move(pose)});
  }
  return posed;
}

}  // namespace tarsier::planar::markers
