// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <string_view>
#include <vector>

// Printed boards for camera calibration, and calibration from images of them.
namespace tarsier::planar::calibration {

enum class BoardKind {
  kChess,        // black and white squares; the points are the inner corners
  kCharuco,      // a chess board with markers in its white squares; the points are numbered
  kCircles,      // black dots in rows shifted by half a period (OpenCV's asymmetric grid)
  kCirclesGrid,  // black dots in straight rows
};

// A printed board. Its frame: x right, y down along the sheet, z into the sheet. A camera in front
// of the board therefore has the same x and y directions. The origin is the first point (top left).
struct BoardSpec {
  BoardKind kind = BoardKind::kChess;
  int columns = 9;  // number of inner corners (chess), squares (charuco) or dots
  int rows = 6;
  // m: side of a square. For dots: distance of neighbours in a straight grid, or of two rows in a
  // shifted one (neighbours in a row are 2 x pitch apart), as in the samples of
  // cv::findCirclesGrid.
  double pitch = 0.025;
  std::string family;  // charuco: markers 0, 1, ... of this family, row by row
  double ratio = 0;    // charuco: marker side / square side; dots: diameter / pitch

  // Throws std::invalid_argument.
  void check() const;

  // Points are the inner corners or dots, in the board's frame (m, z = 0), row by row.
  [[nodiscard]] cv::Size grid() const;  // grid of points; for a shifted grid: dots per row x rows
  [[nodiscard]] int points() const { return grid().area(); }
  [[nodiscard]] cv::Point2d point(int index) const;
  [[nodiscard]] std::string text() const;  // the input of parse_board(), without the pitch
};

// Parses "chess:9x6" (inner corners), "charuco:5x7:6x6_250[:0.75]" (squares, family, marker side /
// square side), "circles:4x11[:0.8]" (shifted rows; dots per row x rows) or
// "circles-grid:7x6[:0.5]". The last number of dots is diameter / pitch. 3..100 points in each
// direction (charuco: 3..100 squares, limited by the markers of the family). Throws UsageError,
// which says what is expected.
[[nodiscard]] BoardSpec parse_board(std::string_view text, double pitch);

// Charuco: the squares {column, row} that hold a marker, in the order of marker numbers: row by
// row, those with column + row odd (the top left square is black).
[[nodiscard]] std::vector<cv::Point> marker_squares(const BoardSpec& spec);

}  // namespace tarsier::planar::calibration
