// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/calibration/board.h"
#include "tarsier/planar/sheets/page.h"

#include <string>
#include <string_view>
#include <vector>

namespace tarsier::planar::sheets {

struct SheetOptions {
  cv::Size2d paper{210, 297};  // mm
  double margin = 10;          // mm, that printers leave white

  [[nodiscard]] OptionFields fields() {
    return {{"paper.width", paper.width, range(30, 2000)},
            {"paper.height", paper.height, range(30, 2000)},
            {"margin", margin, range(0, 200)}};
  }
  void check() const { check_fields(*this); }
};

// "a3", "a4", "a5", "letter", "legal" or "200x300mm", upright. Throws UsageError.
[[nodiscard]] cv::Size2d parse_paper(std::string_view text);

// "0-9", "3,5,8-10": ids of the family, in this order, each once; at most 10000. Throws UsageError.
[[nodiscard]] std::vector<int> parse_ids(std::string_view text, const std::string& family);

// The black cells of a marker with its frame, as runs along rows, in mm: `box` is the whole marker.
[[nodiscard]] std::vector<cv::Rect2d> marker_boxes(const std::string& family, int id,
                                                   const cv::Rect2d& box);

// Markers `side` mm wide (over their black frames), as many on a page as fit, each with a white rim
// of 1.5 cells, its family, id and size under it, and marks to cut along; at the foot a line of 10
// cm (5 where it does not fit) to check the print with. Throws UsageError where not one fits, which
// says what would; more than 500 pages.
[[nodiscard]] std::vector<Page> marker_pages(const std::string& family, const std::vector<int>& ids,
                                             double side, const SheetOptions& options);

// A calibration board in the page's middle (across the page where it fits only so), with what it is
// and the line of 10 cm. Throws UsageError where it does not fit, which says what would.
[[nodiscard]] Page board_page(const calibration::BoardSpec& spec, const SheetOptions& options);

}  // namespace tarsier::planar::sheets
