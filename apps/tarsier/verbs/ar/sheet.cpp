// SPDX-License-Identifier: MIT
#include "tarsier/planar/sheets/sheet.h"

#include "tarsier/core/length.h"
#include "tarsier/planar/markers/dictionary.h"

#include <fmt/format.h>

#include "verbs/ar/ar.h"
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

using Json = nlohmann::ordered_json;

struct SheetFlags {
  std::string output;
  std::string family = "36h11";
  std::string ids = "0-9";
  std::string size = "50mm";
  std::string board;
  std::string square;
  std::string page = "a4";
  std::string margin = "10mm";
  double dpi = 600;
  std::string layout;
};

double millimetres(const std::string& text, const char* flag) {
  return std::round(parse_length(text, flag) * 1e9) / 1e6;
}

void check_raster(const SheetFlags& flags, const planar::sheets::SheetOptions& options) {
  const double pixels = options.paper.area() / (25.4 * 25.4) * flags.dpi * flags.dpi;
  if (flags.output.ends_with(".png") && pixels > 1e8) {
    throw UsageError(
        fmt::format("--dpi {:g}: a page of {:g}x{:g} mm would have {:.0f} million pixels, the "
                    "limit is 100; use .pdf or .svg",
                    flags.dpi, options.paper.width, options.paper.height, pixels / 1e6));
  }
}

ExitStatus run_sheet(const SheetFlags& flags, Context& context) {
  planar::sheets::SheetOptions options;
  options.paper = planar::sheets::parse_paper(flags.page);
  options.margin =
      flags.margin == "0" || flags.margin == "0mm" ? 0 : millimetres(flags.margin, "--margin");
  if (options.margin > 200)
    throw UsageError(fmt::format("--margin {}: expected at most 200mm", flags.margin));
  check_raster(flags, options);
  std::vector<planar::sheets::Page> pages;
  std::string title;
  Json line;
  if (!flags.board.empty()) {
    if (flags.square.empty()) throw UsageError("--board needs --square, such as --square 25mm");
    const planar::calibration::BoardSpec spec =
        planar::calibration::parse_board(flags.board, millimetres(flags.square, "--square") / 1e3);
    pages.push_back(planar::sheets::board_page(spec, options));
    title = fmt::format("board {} {}", spec.text(), flags.square);
    line["board"] = spec.text();
    line["square"] = spec.pitch;
  } else {
    const planar::markers::Dictionary& family = planar::markers::find_dictionary(flags.family);
    const std::vector<int> ids = planar::sheets::parse_ids(flags.ids, flags.family);
    const double size = millimetres(flags.size, "--size");
    pages = planar::sheets::marker_pages(flags.family, ids, size, options);
    if (!flags.layout.empty()) {
      planar::markers::write_marker_board(
          flags.layout, planar::sheets::board_of_page(flags.family, ids, size, options));
      line["layout"] = flags.layout;
    }
    title = fmt::format("markers {} {}", family.name(), flags.size);
    line["family"] = family.name();
    line["ids"] = ids;
    line["size"] = size / 1e3;
  }
  const std::vector<std::string> files =
      planar::sheets::write_pages(flags.output, pages, title, flags.dpi);
  line["pages"] = pages.size();
  line["page_mm"] = {pages[0].size.width, pages[0].size.height};
  line["output"] = files;
  if (context.json) {
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format("{}: {}, {} {} of {:g}x{:g} mm; print at 100 % (actual size)\n",
                           files.size() == 1 ? files[0] : files[0] + " ..", title, pages.size(),
                           pages.size() == 1 ? "page" : "pages", pages[0].size.width,
                           pages[0].size.height));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, SheetFlags& flags) {
  verb.add_option("-o,--output", flags.output,
                  "output: .pdf, .svg or .png (pages of .svg and .png are numbered)")
      .required();
  Flag& family = verb.add_option("--family", flags.family,
                                 "aruco-original, 4x4_50 .. 7x7_1000, 16h5, 25h9, 36h10, 36h11");
  family.show_default();
  Flag& ids = verb.add_option("--ids", flags.ids, "marker ids: 0-9, or 3,5,8-10");
  ids.show_default();
  Flag& size = verb.add_option("--size", flags.size, "side of a marker's black frame: 50mm, 5cm");
  size.show_default();
  Flag& board = verb.add_option(
      "--board", flags.board,
      "board instead of markers: chess:9x6, charuco:5x7:6x6_250, circles:4x11, circles-grid:7x6");
  board.excludes(family).excludes(ids).excludes(size);
  verb.add_option("--square", flags.square, "board: side of a square, or distance of dots")
      .needs(board);
  verb.add_option("--layout", flags.layout,
                  "output file with the places of the markers, for `ar markers --board`")
      .excludes(board);
  verb.add_option("--page", flags.page, "a3, a4, a5, letter, legal or 200x300mm")
      .suggest({"a3", "a4", "a5", "letter", "legal"})
      .show_default();
  verb.add_option("--margin", flags.margin, "white margin: 10mm").show_default();
  verb.add_option("--dpi", flags.dpi, "resolution of .png, 36..2400 dpi")
      .check(range(36.0, 2400.0))
      .show_default();
}

}  // namespace

void add_ar_marker_sheet(Command& ar, Context& context) {
  add_verb<SheetFlags>(ar, "marker-sheet",
                       "write markers or a calibration board to print, true to scale", context,
                       add_flags, run_sheet);
}

}  // namespace tarsier::cli
