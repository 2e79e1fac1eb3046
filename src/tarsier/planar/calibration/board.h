// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <string_view>
#include <vector>

// Printed boards that a camera is calibrated with, and cameras from images of them.
namespace tarsier::planar::calibration {

enum class BoardKind {
  kChess,        // black and white squares; the points are the inner corners
  kCharuco,      // a chess board with markers in its white squares; the points carry numbers
  kCircles,      // black dots in rows that are shifted by half (OpenCV's asymmetric grid)
  kCirclesGrid,  // black dots in straight rows
};

// A board as printed. Its frame: x right, y down along the sheet, z into the sheet, so that a
// camera in front of it sees the board's x and y as its own; the origin is the first point (top
// left).
struct BoardSpec {
  BoardKind kind = BoardKind::kChess;
  int columns = 9;  // of inner corners (chess), squares (charuco) or dots
  int rows = 6;
  // m: side of a square; of dots the distance of neighbours in a straight grid, or of two rows in
  // a shifted one (neighbours in a row are 2 x pitch apart), as cv::findCirclesGrid's samples have
  // it.
  double pitch = 0.025;
  std::string family;  // charuco: markers 0, 1, ... of this family, row by row
  double ratio = 0;    // charuco: marker's side, in squares; dots: diameter, in pitches

  // Throws std::invalid_argument.
  void check() const;

  // Points: inner corners or dots; in the board's frame (m, z = 0), row by row.
  [[nodiscard]] cv::Size grid() const;  // of points; a shifted grid: dots of a row x rows
  [[nodiscard]] int points() const { return grid().area(); }
  [[nodiscard]] cv::Point2d point(int index) const;
  [[nodiscard]] std::string text() const;  // what parse_board() reads, without the pitch
};

// "chess:9x6" (inner corners), "charuco:5x7:6x6_250[:0.75]" (squares, family, marker's share of a
// square), "circles:4x11[:0.8]" (shifted rows; dots in a row x rows), "circles-grid:7x6[:0.5]";
// the last number of dots is their diameter in pitches. 3..100 points each way (charuco: 3..100
// squares, as many markers as the family has). Throws UsageError, which says what is expected.
[[nodiscard]] BoardSpec parse_board(std::string_view text, double pitch);

// Charuco: the squares that hold a marker, by its number: those with column + row odd (the top left
// square is black), row by row. {column, row}.
[[nodiscard]] std::vector<cv::Point> marker_squares(const BoardSpec& spec);

}  // namespace tarsier::planar::calibration
