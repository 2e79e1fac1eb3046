// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/board.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/planar/markers/dictionary.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <optional>

namespace tarsier::planar::calibration {
namespace {

constexpr int kMinSide = 3;
constexpr int kMaxSide = 100;

struct Form {
  BoardKind kind;
  std::string_view name;
  double ratio;
};
constexpr std::array<Form, 4> kForms{{{BoardKind::kChess, "chess", 0},
                                      {BoardKind::kCharuco, "charuco", 0.75},
                                      {BoardKind::kCircles, "circles", 0.8},
                                      {BoardKind::kCirclesGrid, "circles-grid", 0.5}}};

const Form& form_of(BoardKind kind) { return kForms[static_cast<std::size_t>(kind)]; }

std::vector<std::string_view> split(std::string_view text, char at) {
  std::vector<std::string_view> parts;
  while (true) {
    const std::size_t place = text.find(at);
    parts.push_back(text.substr(0, place));
    if (place == std::string_view::npos) return parts;
    text.remove_prefix(place + 1);
  }
}

template <typename T>
std::optional<T> parse_number(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

// The maximum ratio: dots and markers must not touch.
double largest_ratio(BoardKind kind) {
  return kind == BoardKind::kCircles ? 1.3 : kind == BoardKind::kCharuco ? 0.95 : 0.9;
}

}  // namespace

void BoardSpec::check() const {
  TARSIER_REQUIRE(
      columns >= kMinSide && columns <= kMaxSide && rows >= kMinSide && rows <= kMaxSide,
      "a board of {}x{}", columns, rows);
  TARSIER_REQUIRE(pitch > 0 && std::isfinite(pitch), "a pitch of {} m", pitch);
  if (kind == BoardKind::kChess) return;
  TARSIER_REQUIRE(ratio >= 0.2 && ratio <= largest_ratio(kind), "a ratio of {}", ratio);
  if (kind == BoardKind::kCharuco) {
    const int markers = columns * rows / 2;
    TARSIER_REQUIRE(markers <= markers::find_dictionary(family).size(), "{} markers of {}", markers,
                    family);
  }
}

cv::Size BoardSpec::grid() const {
  return kind == BoardKind::kCharuco ? cv::Size(columns - 1, rows - 1) : cv::Size(columns, rows);
}

cv::Point2d BoardSpec::point(int index) const {
  TARSIER_REQUIRE(index >= 0 && index < points(), "point {} of {}", index, points());
  const int column = index % grid().width;
  const int row = index / grid().width;
  if (kind == BoardKind::kCircles) return {(2 * column + row % 2) * pitch, row * pitch};
  return {column * pitch, row * pitch};
}

std::string BoardSpec::text() const {
  std::string text = fmt::format("{}:{}x{}", form_of(kind).name, columns, rows);
  if (kind == BoardKind::kCharuco) text += ':' + family;
  if (kind != BoardKind::kChess && ratio != form_of(kind).ratio) text += fmt::format(":{}", ratio);
  return text;
}

BoardSpec parse_board(std::string_view text, double pitch) {
  const auto fail = [&](const std::string& reason) {
    return UsageError(
        fmt::format("option 'board' '{}': {}; expected is chess:9x6 (inner corners), "
                    "charuco:5x7:6x6_250 (squares), "
                    "circles:4x11 (shifted rows) or circles-grid:7x6",
                    printable(text.substr(0, 60)), reason));
  };
  const std::vector<std::string_view> parts = split(text, ':');
  const Form* form = nullptr;
  for (const Form& known : kForms)
    if (known.name == parts[0]) form = &known;
  if (form == nullptr) throw fail("no such kind of board");
  const bool is_charuco = form->kind == BoardKind::kCharuco;
  const std::size_t needed = is_charuco ? 3 : 2;
  if (parts.size() < needed) throw fail(is_charuco ? "no size or family" : "no size");
  if (parts.size() > needed + (form->kind == BoardKind::kChess ? 0 : 1)) throw fail("too long");

  BoardSpec spec;
  spec.kind = form->kind;
  spec.pitch = pitch;
  spec.ratio = form->ratio;
  const std::vector<std::string_view> sides = split(parts[1], 'x');
  const auto columns = parse_number<int>(sides[0]);
  const auto rows = parse_number<int>(sides.size() == 2 ? sides[1] : std::string_view());
  if (!columns || !rows) throw fail(fmt::format("'{}' is not a size", printable(parts[1])));
  if (*columns < kMinSide || *rows < kMinSide || *columns > kMaxSide || *rows > kMaxSide)
    throw fail(fmt::format("a side is not {}..{}", kMinSide, kMaxSide));
  spec.columns = *columns;
  spec.rows = *rows;
  if (parts.size() > needed) {
    const auto ratio = parse_number<double>(parts[needed]);
    const double max_ratio = largest_ratio(spec.kind);
    if (!ratio || !(*ratio >= 0.2 && *ratio <= max_ratio))
      throw fail(fmt::format("the last number is not 0.2..{}", max_ratio));
    spec.ratio = *ratio;
  }
  if (is_charuco) {
    const markers::Dictionary& family = markers::find_dictionary(parts[2]);
    spec.family = family.name();
    if (const int markers = spec.columns * spec.rows / 2; markers > family.size()) {
      throw fail(
          fmt::format("{} markers are needed, {} has {}", markers, spec.family, family.size()));
    }
  }
  return spec;
}

std::vector<cv::Point> marker_squares(const BoardSpec& spec) {
  TARSIER_REQUIRE(spec.kind == BoardKind::kCharuco, "{}", spec.text());
  std::vector<cv::Point> squares;
  for (int row = 0; row < spec.rows; ++row)
    for (int column = 0; column < spec.columns; ++column)
      if ((row + column) % 2 == 1) squares.emplace_back(column, row);
  return squares;
}

}  // namespace tarsier::planar::calibration
