// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/calibration/board.h"
#include "tarsier/planar/markers/board.h"
#include "tarsier/planar/sheets/page.h"

#include <string>
#include <string_view>
#include <vector>

namespace tarsier::planar::sheets {

struct SheetOptions {
  cv::Size2d paper{210, 297};  // mm
  double margin = 10;          // mm, white border that printers need

  [[nodiscard]] OptionFields fields() {
    return {{"paper.width", paper.width, range(30, 2000)},
            {"paper.height", paper.height, range(30, 2000)},
            {"margin", margin, range(0, 200)}};
  }
  void check() const { check_fields(*this); }
};

// Parses "a3", "a4", "a5", "letter", "legal" or "200x300mm", portrait. Throws UsageError.
[[nodiscard]] cv::Size2d parse_paper(std::string_view text);

// Parses "0-9", "3,5,8-10": ids of the family in this order, without duplicates; at most 10000.
// Throws UsageError.
[[nodiscard]] std::vector<int> parse_ids(std::string_view text, const std::string& family);

// The black cells of a marker with its frame, as horizontal runs, in mm. `box` is the whole marker.
[[nodiscard]] std::vector<cv::Rect2d> marker_boxes(const std::string& family, int id,
                                                   const cv::Rect2d& box);

// Pages of markers `side` mm wide (outer side of the black frame), as many per page as fit. Each
// has a white margin of 1.5 cells, its family, id and size below it, and cut marks. At the foot is
// a line of 10 cm (5 cm if it does not fit) to check the scale. Throws UsageError for more than 500
// pages, or if no marker fits; then the message names a size that fits.
[[nodiscard]] std::vector<Page> marker_pages(const std::string& family, const std::vector<int>& ids,
                                             double side, const SheetOptions& options);

// The places of these markers on their page, as a board. Its origin is the centre of the markers.
// Throws UsageError if they need more than one page.
[[nodiscard]] markers::MarkerBoard board_of_page(const std::string& family,
                                                 const std::vector<int>& ids, double side,
                                                 const SheetOptions& options);

// A page with a calibration board in its centre (landscape if it fits only so), its description and
// the 10 cm line. Throws UsageError if it does not fit; the message names a size that fits.
[[nodiscard]] Page board_page(const calibration::BoardSpec& spec, const SheetOptions& options);

}  // namespace tarsier::planar::sheets
