// SPDX-License-Identifier: MIT
#include "tarsier/planar/sheets/sheet.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/planar/markers/dictionary.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <set>

namespace tarsier::planar::sheets {
namespace {

using calibration::BoardKind;
using calibration::BoardSpec;

constexpr double kRim = 1.5;        // cells of white margin around a marker
constexpr double kLabel = 2.2;      // mm, height of letters
constexpr double kLabelRoom = 4.5;  // mm below a marker
constexpr double kFoot = 13;        // mm, for the ruler
constexpr double kCut = 3;          // mm, length of cut marks
constexpr std::size_t kMaxPages = 500;
constexpr std::size_t kMaxIds = 10'000;

struct Paper {
  std::string_view name;
  double width;  // mm
  double height;
};
constexpr std::array<Paper, 5> kPapers{{{"a3", 297, 420},
                                        {"a4", 210, 297},
                                        {"a5", 148, 210},
                                        {"letter", 215.9, 279.4},
                                        {"legal", 215.9, 355.6}}};

template <typename T>
std::optional<T> parse_number(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

// A number without trailing zeros.
std::string number_text(double mm) { return fmt::format("{:g}", std::round(mm * 1000) / 1000); }

// A ruler of 100 mm (or 50, or 20) with marks every 10 mm, at the foot of the page.
void add_ruler(Page& page, double margin) {
  double length = 100;
  for (const double shorter : {50.0, 20.0, 10.0})
    if (length > page.size.width - 2 * margin) length = shorter;
  if (length > page.size.width - 2 * margin) return;
  const double y = page.size.height - margin - 5.5;
  const double left = 0.5 * (page.size.width - length);
  page.lines.push_back({{left, y}, {left + length, y}, 0.15, 0});
  for (int k = 0; k <= cvRound(length / 10); ++k) {
    const bool is_end = k == 0 || k == cvRound(length / 10);
    page.lines.push_back({{left + 10 * k, y - (is_end ? 2.5 : 1.2)}, {left + 10 * k, y}, 0.15, 0});
  }
  page.texts.push_back(
      {{left, y + 3.6},
       kLabel,
       fmt::format("{} cm: print at 100 % (actual size) and measure this line", length / 10),
       0});
}

// Short lines outward from the corners of a box.
void add_cut_marks(Page& page, const cv::Rect2d& box) {
  for (const double x : {box.x, box.x + box.width}) {
    for (const double y : {box.y, box.y + box.height}) {
      const double sx = x == box.x ? 1 : -1;
      const double sy = y == box.y ? 1 : -1;
      page.lines.push_back({{x, y}, {x + sx * kCut, y}, 0.1, 0.55});
      page.lines.push_back({{x, y}, {x, y + sy * kCut}, 0.1, 0.55});
    }
  }
}

struct Grid {
  int columns = 0;
  int rows = 0;
  double width = 0;  // mm, of one position
  double height = 0;
};

Grid grid_for(double side, int cells, const SheetOptions& options) {
  const double rim = kRim * side / (cells + 2);
  Grid grid;
  grid.width = side + 2 * rim;
  grid.height = side + 2 * rim + kLabelRoom;
  grid.columns = cvFloor((options.paper.width - 2 * options.margin + 1e-9) / grid.width);
  grid.rows = cvFloor((options.paper.height - 2 * options.margin - kFoot + 1e-9) / grid.height);
  return grid;
}

// The k-th position. The grid is centred on the page.
cv::Rect2d tile_at(const Grid& grid, int k, const SheetOptions& options) {
  const double left = 0.5 * (options.paper.width - grid.columns * grid.width);
  return {left + k % grid.columns * grid.width, options.margin + k / grid.columns * grid.height,
          grid.width, grid.height};
}

// Chess squares and dots of a board. `origin` is the corner of the first square, or of the first
// dot's cell.
Fill board_fill(const BoardSpec& spec, const cv::Point2d& origin, double pitch) {
  Fill fill;
  if (spec.kind == BoardKind::kCircles || spec.kind == BoardKind::kCirclesGrid) {
    for (int k = 0; k < spec.points(); ++k) {
      const cv::Point2d at = spec.point(k) * (pitch / spec.pitch);
      fill.dots.push_back({origin + at + cv::Point2d(pitch, pitch), 0.5 * spec.ratio * pitch});
    }
    return fill;
  }
  const bool is_chess = spec.kind == BoardKind::kChess;
  const int columns = spec.columns + (is_chess ? 1 : 0);
  const int rows = spec.rows + (is_chess ? 1 : 0);
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column)
      if ((row + column) % 2 == 0)
        fill.boxes.emplace_back(origin.x + column * pitch, origin.y + row * pitch, pitch, pitch);
  if (is_chess) return fill;
  int id = 0;
  for (const cv::Point& square : marker_squares(spec)) {
    const double rim = 0.5 * (1 - spec.ratio) * pitch;
    const cv::Rect2d box(origin.x + square.x * pitch + rim, origin.y + square.y * pitch + rim,
                         spec.ratio * pitch, spec.ratio * pitch);
    const auto cells = marker_boxes(spec.family, id++, box);
    fill.boxes.insert(fill.boxes.end(), cells.begin(), cells.end());
  }
  return fill;
}

// Size of the print, mm.
cv::Size2d board_size(const BoardSpec& spec, double pitch) {
  if (spec.kind == BoardKind::kCircles)
    return {(2 * spec.columns + 2) * pitch, (spec.rows + 1) * pitch};
  if (spec.kind == BoardKind::kCharuco) return {spec.columns * pitch, spec.rows * pitch};
  return {(spec.columns + 1) * pitch, (spec.rows + 1) * pitch};
}

}  // namespace

cv::Size2d parse_paper(std::string_view text) {
  for (const Paper& paper : kPapers)
    if (paper.name == text) return {paper.width, paper.height};
  std::string_view sides = text;
  if (sides.ends_with("mm")) {
    sides.remove_suffix(2);
    if (const std::size_t x = sides.find('x'); x != std::string_view::npos) {
      const auto width = parse_number<double>(sides.substr(0, x));
      const auto height = parse_number<double>(sides.substr(x + 1));
      if (width && height && *width >= 30 && *width <= 2000 && *height >= 30 && *height <= 2000)
        return {*width, *height};
    }
  }
  throw UsageError(fmt::format(
      "option 'page' '{}': a3, a4, a5, letter, legal or WIDTHxHEIGHTmm (30..2000 mm) is expected",
      printable(text.substr(0, 60))));
}

std::vector<int> parse_ids(std::string_view text, const std::string& family) {
  const markers::Dictionary& dictionary = markers::find_dictionary(family);
  const auto fail = [&](const std::string& reason) {
    return UsageError(fmt::format("option 'ids' '{}': {}; 0-9 or 3,5,8-10 is expected",
                                  printable(text.substr(0, 60)), reason));
  };
  std::vector<int> ids;
  std::set<int> seen;
  std::string_view rest = text;
  while (true) {
    const std::size_t comma = rest.find(',');
    const std::string_view part = rest.substr(0, comma);
    const std::size_t dash = part.find('-');
    const auto first = parse_number<int>(part.substr(0, dash));
    const auto last =
        dash == std::string_view::npos ? first : parse_number<int>(part.substr(dash + 1));
    if (!first || !last || *first > *last) throw fail(fmt::format("'{}'", printable(part)));
    if (*first < 0 || *last >= dictionary.size()) {
      throw fail(fmt::format("{} has the ids 0..{}", dictionary.name(), dictionary.size() - 1));
    }
    for (int id = *first; id <= *last; ++id) {
      if (seen.insert(id).second) ids.push_back(id);
      if (ids.size() > kMaxIds) throw fail(fmt::format("more than {} markers", kMaxIds));
    }
    if (comma == std::string_view::npos) return ids;
    rest.remove_prefix(comma + 1);
  }
}

std::vector<cv::Rect2d> marker_boxes(const std::string& family, int id, const cv::Rect2d& box) {
  const markers::Dictionary& dictionary = markers::find_dictionary(family);
  const int n = dictionary.cells();
  const markers::Code code = dictionary.code(id);
  const double cell_x = box.width / (n + 2);
  const double cell_y = box.height / (n + 2);
  const auto is_black = [&](int column, int row) {
    if (column == 0 || row == 0 || column == n + 1 || row == n + 1) return true;
    const int place = n * n - 1 - ((row - 1) * n + column - 1);
    return ((code >> place) & 1U) == 0;
  };
  std::vector<cv::Rect2d> boxes;
  for (int row = 0; row < n + 2; ++row) {
    for (int column = 0; column < n + 2;) {
      int end = column;
      while (end < n + 2 && is_black(end, row)) ++end;
      if (end > column) {
        boxes.emplace_back(box.x + column * cell_x, box.y + row * cell_y, (end - column) * cell_x,
                           cell_y);
      }
      column = std::max(end, column + 1);
    }
  }
  return boxes;
}

std::vector<Page> marker_pages(const std::string& family, const std::vector<int>& ids, double side,
                               const SheetOptions& options) {
  options.check();
  TARSIER_REQUIRE(side > 0 && std::isfinite(side), "{} mm", side);
  TARSIER_REQUIRE(!ids.empty(), "{} ids", ids.size());
  const markers::Dictionary& dictionary = markers::find_dictionary(family);
  const Grid grid = grid_for(side, dictionary.cells(), options);
  if (grid.columns < 1 || grid.rows < 1) {
    const double rims = 1 + 2 * kRim / (dictionary.cells() + 2);
    const double most = std::min(options.paper.width - 2 * options.margin,
                                 options.paper.height - 2 * options.margin - kFoot - kLabelRoom) /
                        rims;
    throw UsageError(fmt::format(
        "a marker of {} mm with its white rim does not fit a page of {}x{} mm: {}",
        number_text(side), number_text(options.paper.width), number_text(options.paper.height),
        most >= 1 ? fmt::format("a side of up to {} mm does, or a larger page", cvFloor(most))
                  : "a larger page or a smaller margin is needed"));
  }
  if (side / (dictionary.cells() + 2) < 0.3) {
    throw UsageError(fmt::format("a marker of {} mm has cells of {:.2f} mm: no printer draws them",
                                 number_text(side), side / (dictionary.cells() + 2)));
  }
  const auto on_page = static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows);
  if ((ids.size() + on_page - 1) / on_page > kMaxPages) {
    throw UsageError(fmt::format("{} markers of {} mm are more than {} pages", ids.size(),
                                 number_text(side), kMaxPages));
  }
  const double rim = kRim * side / (dictionary.cells() + 2);
  std::vector<Page> pages;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const std::size_t place = k % on_page;
    if (place == 0) {
      Page page;
      page.size = options.paper;
      add_ruler(page, options.margin);
      pages.push_back(page);
    }
    Page& page = pages.back();
    const cv::Rect2d tile = tile_at(grid, static_cast<int>(place), options);
    const cv::Rect2d box(tile.x + rim, tile.y + rim, side, side);
    page.fills.push_back({marker_boxes(family, ids[k], box), {}, 0});
    const std::string label =
        side >= 35 ? fmt::format("{}  id {}  {} mm", dictionary.name(), ids[k], number_text(side))
                   : fmt::format("id {}", ids[k]);
    const double height = std::min(kLabel, side / 6);
    page.texts.push_back({{box.x, tile.y + tile.height - 1.5}, height, label, 0.35});
    add_cut_marks(page, tile);
  }
  return pages;
}

markers::MarkerBoard board_of_page(const std::string& family, const std::vector<int>& ids,
                                   double side, const SheetOptions& options) {
  if (marker_pages(family, ids, side, options).size() > 1) {
    throw UsageError(
        fmt::format("{} markers of {} mm do not fit one page: a board needs fewer, "
                    "smaller markers or a larger page",
                    ids.size(), number_text(side)));
  }
  const markers::Dictionary& dictionary = markers::find_dictionary(family);
  const Grid grid = grid_for(side, dictionary.cells(), options);
  const double rim = kRim * side / (dictionary.cells() + 2);
  markers::MarkerBoard board{dictionary.name(), {}};
  cv::Rect2d all;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const cv::Rect2d tile = tile_at(grid, static_cast<int>(k), options);
    const cv::Rect2d box(tile.x + rim, tile.y + rim, side, side);
    all = k == 0 ? box : all | box;
    board.markers.push_back({ids[k], {box.x + side / 2, box.y + side / 2}, 0, side / 1000});
  }
  const cv::Point2d origin(all.x + all.width / 2, all.y + all.height / 2);
  for (markers::BoardMarker& marker : board.markers) {
    const cv::Point2d offset = marker.center - origin;  // mm, y down
    marker.center = {offset.x / 1000, (0 - offset.y) / 1000};
  }
  return board;
}

Page board_page(const BoardSpec& spec, const SheetOptions& options) {
  spec.check();
  options.check();
  const double pitch = spec.pitch * 1000;
  const cv::Size2d print = board_size(spec, pitch);
  const auto fits = [&](const cv::Size2d& paper) {
    return print.width <= paper.width - 2 * options.margin + 1e-9 &&
           print.height <= paper.height - 2 * options.margin - kFoot + 1e-9;
  };
  Page page;
  page.size = options.paper;
  const cv::Size2d across(options.paper.height, options.paper.width);
  if (!fits(page.size)) page.size = across;
  if (!fits(page.size)) {
    const auto max_of = [&](const cv::Size2d& paper) {
      return pitch * std::min((paper.width - 2 * options.margin) / print.width,
                              (paper.height - 2 * options.margin - kFoot) / print.height);
    };
    const double most = std::max(max_of(options.paper), max_of(across));
    throw UsageError(fmt::format(
        "the board {} with {} mm is {}x{} mm large and does not fit a page of {}x{} mm: {}",
        spec.text(), number_text(pitch), number_text(print.width), number_text(print.height),
        number_text(options.paper.width), number_text(options.paper.height),
        most >= 1 ? fmt::format("a square of up to {:.1f} mm does, or a larger page",
                                std::floor(most * 10) / 10)
                  : "a larger page or a smaller margin is needed"));
  }
  const cv::Point2d origin(0.5 * (page.size.width - print.width),
                           0.5 * (page.size.height - kFoot - print.height));
  page.fills.push_back(board_fill(spec, origin, pitch));
  add_ruler(page, options.margin);
  // Beside the ruler, or above the foot if the page is narrow.
  page.texts.push_back({{options.margin, page.size.height - options.margin - 10.5},
                        kLabel,
                        fmt::format("--board {} --square {}mm", spec.text(), number_text(pitch)),
                        0.35});
  return page;
}

}  // namespace tarsier::planar::sheets
