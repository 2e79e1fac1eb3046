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

// Where markers of known size are. A marker's frame: origin at its centre, x right, y up, z out of
// the sheet, metres.
namespace tarsier::planar::markers {

struct MarkerPose {
  geometry::Rigid3 camera_from_marker;        // in a video: smoothed, if that is asked for
  double rms_px = 0;                          // of the pose as measured, at the corners
  std::optional<geometry::PlanarPose> other;  // the second pose that explains the corners
  // The smaller of the two errors over the larger, 0..1: near 1 one image can not tell the poses
  // apart; 0 where there is no other.
  double ambiguity = 0;
};

struct PosedMarker {
  Marker marker;
  std::optional<MarkerPose> pose;  // empty where the corners have none, or no size is known
};

// The corners of a marker `size` m wide in its frame, top left first, clockwise.
[[nodiscard]] std::vector<cv::Point2d> corners_on_marker(double size);

// Of one image: the pose with the smaller error, corners weighted by how surely they are known
// where that is stated. Throws std::invalid_argument unless size > 0.
[[nodiscard]] std::optional<MarkerPose> pose_of_marker(const Marker& marker, double size,
                                                       const geometry::Camera& camera);

// Of one image, each on its own.
[[nodiscard]] std::vector<PosedMarker> pose_markers(std::vector<Marker> markers, double size,
                                                    const geometry::Camera& camera);

// A marker of a board: its id and the pose of its frame in the board's (z out of the sheet, all of
// them in the plane z = 0).
struct BoardMarker {
  int id = 0;
  cv::Point2d middle;  // m
  double turn = 0;     // radians, anticlockwise
  double size = 0;     // m
};
// One pose, camera from board, of all markers of the board that were found: far steadier than that
// of each. Empty where none was found.
[[nodiscard]] std::optional<MarkerPose> pose_of_board(std::span<const Marker> markers,
                                                      std::span<const BoardMarker> board,
                                                      const geometry::Camera& camera);

// Poses over a video, for each marker its own track. Starts empty; belongs to one size of markers
// (another size starts again).
struct PoseTracks {
  struct Track {
    int id = 0;
    Eigen::Vector2d middle{0, 0};  // px
    double side = 0;               // px
    double time = 0;               // s
    bool is_taken = false;
    geometry::PlanarTrackState state;
  };
  double size = 0;  // m
  std::vector<Track> tracks;
};

// The markers of the next frame, at `time` (s), and their poses; two of the same id are kept apart
// by their places.
[[nodiscard]] std::vector<PosedMarker> track_markers(std::vector<Marker> markers, double size,
                                                     const geometry::Camera& camera, double time,
                                                     const geometry::PlanarTrackOptions& options,
                                                     PoseTracks& tracks);

}  // namespace tarsier::planar::markers
