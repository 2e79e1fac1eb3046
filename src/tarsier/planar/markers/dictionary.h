// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Square black-and-white markers: a black frame one cell wide around n x n cells that spell an id.
namespace tarsier::planar::markers {

// The n x n cells of a marker, row by row from its top left cell, one bit each (1 = white); the
// first cell is bit n*n - 1.
using Code = std::uint64_t;

// What the cells of an image mean.
struct Match {
  int id = 0;
  int rotation = 0;  // quarter turns: how often the read cells were turned anticlockwise to match
  int errors = 0;    // cells that differ
};

// All markers of one family.
class Dictionary {
 public:
  // `codes` by id. Throws std::invalid_argument unless 3 <= cells <= 8, 1 <= codes <= 65536 and no
  // code has more bits than cells.
  Dictionary(std::string name, int cells, std::vector<Code> codes);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] int cells() const { return cells_; }  // n
  [[nodiscard]] int size() const { return static_cast<int>(codes_.size()); }
  // Throws std::invalid_argument for an id that is not in the family.
  [[nodiscard]] Code code(int id) const;
  // The smallest number of cells in which two markers differ, over all turns (also of one marker
  // with itself).
  [[nodiscard]] int distance() const { return distance_; }
  // How many wrong cells can be mended without ambiguity: (distance - 1) / 2.
  [[nodiscard]] int correctable() const { return (distance_ - 1) / 2; }

  // The marker and turn with the fewest differing cells; empty where these are more than
  // `max_errors`, or where a second marker is as near. Cells under `unknown` (same layout) are not
  // compared.
  [[nodiscard]] std::optional<Match> match(Code read, int max_errors, Code unknown = 0) const;
  // The `count` markers and turns that agree best with how bright the cells are (n * n numbers, row
  // by row, black below 0, white above): largest sum of +-brightness, best first. `errors` counts
  // the cells whose sign differs. Throws std::invalid_argument for another number of cells.
  [[nodiscard]] std::vector<Match> nearest(std::span<const float> brightness, int count) const;

 private:
  void index();

  std::string name_;
  int cells_;
  std::vector<Code> codes_;
  int distance_ = 0;
  struct Turned {
    Code code;
    std::uint32_t id_and_turn;  // id * 4 + turn
  };
  std::vector<Turned> turned_;  // every code in its four turns, sorted by code
};

// The cells turned by a quarter: the image turned clockwise.
[[nodiscard]] Code turned_clockwise(Code code, int cells);

// The names that find_dictionary() knows: "aruco-original", "4x4_50" .. "7x7_1000", "16h5", "25h9",
// "36h10", "36h11".
[[nodiscard]] std::vector<std::string> dictionary_names();

// A family by name; "4x4" .. "7x7" are short for 4x4_1000 .. 7x7_1000; "orig" and "original" for
// aruco-original; AprilTags also as "tag36h11". Built once, then shared. Throws UsageError, which
// lists the names, for any other.
[[nodiscard]] const Dictionary& find_dictionary(std::string_view name);

}  // namespace tarsier::planar::markers
