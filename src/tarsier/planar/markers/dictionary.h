// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Square black-and-white markers: a black frame, one cell wide, around n x n cells that encode an
// id.
namespace tarsier::planar::markers {

// The n x n cells of a marker, row by row from its top left cell, one bit each (1 = white); the
// first cell is bit n*n - 1.
using Code = std::uint64_t;

// The result of decoding cells.
struct Match {
  int id = 0;
  // Quarter turns: number of anticlockwise turns of the read cells that give the match.
  int rotation = 0;
  int errors = 0;  // cells that differ
};

// All markers of one family.
class Dictionary {
 public:
  // `codes` in the order of ids. Throws std::invalid_argument unless 3 <= cells <= 8, 1 <= codes <=
  // 65536 and no code has more bits than cells.
  Dictionary(std::string name, int cells, std::vector<Code> codes);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] int cells() const { return cells_; }  // n
  [[nodiscard]] int size() const { return static_cast<int>(codes_.size()); }
  // Throws std::invalid_argument for an id that is not in the family.
  [[nodiscard]] Code code(int id) const;
  // The minimum Hamming distance of two markers over all rotations (also of one marker to its own
  // rotations).
  [[nodiscard]] int distance() const { return distance_; }
  // Number of wrong cells that can be corrected without ambiguity: (distance - 1) / 2.
  [[nodiscard]] int correctable() const { return (distance_ - 1) / 2; }

  // The marker and rotation with the fewest differing cells. Empty if these are more than
  // `max_errors`, or if a second marker is equally near. Cells set in `unknown` (same layout) are
  // not compared.
  [[nodiscard]] std::optional<Match> match(Code read, int max_errors, Code unknown = 0) const;
  // The `count` markers and rotations that agree best with the brightness of the cells (n * n
  // numbers, row by row, black below 0, white above): largest sum of +-brightness, best first.
  // `errors` counts the cells whose sign differs. Throws std::invalid_argument for another number
  // of cells.
  [[nodiscard]] std::vector<Match> nearest(std::span<const float> brightness, int count) const;

 private:
  void index();

  std::string name_;
  int cells_;
  std::vector<Code> codes_;
  int distance_ = 0;
  struct RotatedCode {
    Code code;
    std::uint32_t id_and_rotation;  // id * 4 + turn
  };
  std::vector<RotatedCode> rotated_codes_;  // every code in its four rotations, sorted by code
};

// The cells after a clockwise quarter turn of the image.
[[nodiscard]] Code rotated_clockwise(Code code, int cells);

// The names that find_dictionary() knows: "aruco-original", "4x4_50" .. "7x7_1000", "16h5", "25h9",
// "36h10", "36h11".
[[nodiscard]] std::vector<std::string> dictionary_names();

// Finds a family by name. "4x4" .. "7x7" stand for 4x4_1000 .. 7x7_1000, "orig" and "original" for
// aruco-original; AprilTags are also known as "tag36h11". A family is built once, then shared.
// Throws UsageError, which lists the names, for an unknown name.
[[nodiscard]] const Dictionary& find_dictionary(std::string_view name);

}  // namespace tarsier::planar::markers
