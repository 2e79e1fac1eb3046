// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/markers/pose.h"

#include <opencv2/core/types.hpp>

#include <optional>
#include <span>
#include <string>
#include <vector>

// Boards: several markers at known places on one flat sheet. Their common pose is much more stable
// than that of a single marker, and holds while some of them are hidden.
namespace tarsier::planar::markers {

// A marker of a board: its id and the pose of its frame in the board's frame (z out of the sheet,
// all markers in the plane z = 0).
struct BoardMarker {
  int id = 0;
  cv::Point2d center;   // m
  double rotation = 0;  // radians, anticlockwise
  double size = 0;      // m
};

struct MarkerBoard {
  std::string family;  // a name that find_dictionary() accepts
  std::vector<BoardMarker> markers;

  // Throws std::invalid_argument for no marker, a repeated id or one that the family does not have,
  // or sizes and places outside (0, 1000] and [-1000, 1000] m, and UsageError for an unknown
  // family.
  void check() const;
};

// Reads {"family": "36h11", "markers": [{"id": 0, "center": [x, y], "size": s, "rotation": r},
// ..]}: metres, and degrees anticlockwise ("rotation" may be absent). Throws InputError, which
// names the file and the place.
[[nodiscard]] MarkerBoard read_marker_board(const std::string& path);
// The same text. `name` is the file's name in errors.
[[nodiscard]] MarkerBoard parse_marker_board(const std::string& text, const std::string& name);
// Writes it atomically. Throws OutputError.
void write_marker_board(const std::string& path, const MarkerBoard& board);

// The corners of the board's markers among `markers`, on the board (m) and in the image (px).
struct BoardCorners {
  std::vector<int> ids;  // of these markers; each has four corners
  std::vector<cv::Point2d> on_board;
  std::vector<cv::Point2d> pixels;
};
[[nodiscard]] BoardCorners corners_on_board(std::span<const Marker> markers,
                                            std::span<const BoardMarker> board);

// One pose, camera from board, from all detected markers of the board. Empty if no marker of the
// board was detected.
[[nodiscard]] std::optional<MarkerPose> pose_of_board(std::span<const Marker> markers,
                                                      std::span<const BoardMarker> board,
                                                      const geometry::Camera& camera);
// State between frames of a video.
struct BoardTrack {
  std::vector<int> ids;  // of the visible markers
  geometry::PlanarTrackState state;
};
// The same for the next frame, at `time` (s). Smoothing restarts where other markers are visible.
[[nodiscard]] std::optional<MarkerPose> track_board(std::span<const Marker> markers,
                                                    std::span<const BoardMarker> board,
                                                    const geometry::Camera& camera, double time,
                                                    const geometry::PlanarTrackOptions& options,
                                                    BoardTrack& track);

}  // namespace tarsier::planar::markers
