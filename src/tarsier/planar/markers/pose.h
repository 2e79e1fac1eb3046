// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/planar_track.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/markers/detector.h"

#include <Eigen/Core>

#include <optional>
#include <span>
#include <vector>

// Poses of markers of known size. A marker's frame: origin at its centre, x right, y up, z out of
// the sheet, metres.
namespace tarsier::planar::markers {

struct MarkerPose {
  geometry::Rigid3 camera_from_marker;        // in a video: smoothed, if requested
  double rms_px = 0;                          // of the measured pose, at the corners
  std::optional<geometry::PlanarPose> other;  // the second solution
  // The smaller of the two errors divided by the larger, 0..1. Near 1 the two solutions cannot be
  // distinguished from one image. 0 if there is no second solution.
  double ambiguity = 0;
};

struct PosedMarker {
  Marker marker;
  std::optional<MarkerPose> pose;  // empty if the corners have no pose, or if the size is not known
};

// MarkerPose::ambiguity of two solutions.
[[nodiscard]] double ambiguity_of(const geometry::PlanarPose& pose,
                                  const std::optional<geometry::PlanarPose>& other);

// The corners, in its frame, of a marker `size` m wide: top left first, clockwise.
[[nodiscard]] std::vector<cv::Point2d> corners_on_marker(double size);

// The pose with the smaller error, from one image. Corners are weighted by their information matrix
// if it is given. Throws std::invalid_argument unless size > 0.
[[nodiscard]] std::optional<MarkerPose> pose_of_marker(const Marker& marker, double size,
                                                       const geometry::Camera& camera);

// The poses of all markers of one image, independently.
[[nodiscard]] std::vector<PosedMarker> pose_markers(std::vector<Marker> markers, double size,
                                                    const geometry::Camera& camera);

// Poses in a video, one track per marker. Starts empty. It holds for one size of markers; another
// size restarts it.
struct PoseTracks {
  struct Track {
    int id = 0;
    Eigen::Vector2d center{0, 0};  // px
    double side = 0;               // px
    double time = 0;               // s
    bool is_matched = false;
    geometry::PlanarTrackState state;
  };
  double size = 0;  // m
  std::vector<Track> tracks;
};

// The markers of the next frame, at `time` (s), with their poses. Markers with the same id are
// distinguished by their positions.
[[nodiscard]] std::vector<PosedMarker> track_markers(std::vector<Marker> markers, double size,
                                                     const geometry::Camera& camera, double time,
                                                     const geometry::PlanarTrackOptions& options,
                                                     PoseTracks& tracks);

}  // namespace tarsier::planar::markers
