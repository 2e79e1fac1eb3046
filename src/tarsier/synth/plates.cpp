// SPDX-License-Identifier: MIT
#include "tarsier/synth/plates.h"

#include "tarsier/core/require.h"
#include "tarsier/synth/glyphs.h"
#include "tarsier/synth/plate_painter.h"
#include "tarsier/synth/plate_texts.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

namespace tarsier::synth {
namespace {

cv::Mat slanted(const cv::Mat& mask, double slant) {
  if (std::abs(slant) < 0.01) return mask;
  const double shift = std::abs(slant) * mask.rows;
  const cv::Mat map = (cv::Mat_<double>(2, 3) << 1, -slant, slant > 0 ? shift : 0, 0, 1, 0);
  cv::Mat result;
  cv::warpAffine(mask, result, map, {mask.cols + cvRound(shift), mask.rows});
  return result;
}

// --- styles ---

PlateStyle standard_style(PlateKind kind, int rows) {
  PlateStyle style;
  switch (kind) {
    case PlateKind::kSpain:
    case PlateKind::kEurope:
      style.band_left = 40;
      break;
    case PlateKind::kSpainOld:
      style.group_gap = 30;
      style.digit_width = 40;
      break;
    case PlateKind::kSpainSquare:
      style.width = 340;
      style.height = 220;
      style.band_left = 40;
      break;
    case PlateKind::kSpainMoto:
      style.width = 220;
      style.height = 160;
      style.cap_height = 56;
      style.digit_width = 32;
      style.gap = 10;
      style.band_left = 30;
      break;
    case PlateKind::kUs:
      style.width = 305;
      style.height = 152;
      style.cap_height = 66;
      style.digit_width = 32;
      style.gap = 8;
      style.group_gap = 24;
      style.centre = 0.53;
      style.corner = 12;
      style.border = 0;
      break;
    case PlateKind::kBrazil:
      style.width = 400;
      style.height = 130;
      style.cap_height = 63;
      style.digit_width = 38;
      style.gap = 9;
      style.group_gap = 26;
      style.centre = 0.6;
      style.ground = style.ground_below = Color(190, 190, 190);
      break;
  }
  if (rows == 2 && kind == PlateKind::kUs) {
    style.width = 178;
    style.height = 102;
    style.cap_height = 36;
    style.digit_width = 20;
  }
  return style;
}

void vary_colors(PlateStyle& style, PlateKind kind, Rng& rng) {
  const double k = rng.uniform();
  const double lightness = rng.uniform(200, 255);
  Color ground(lightness, lightness, lightness);
  if (kind == PlateKind::kBrazil && k < 0.6) {
    ground = Color::all(rng.uniform(150, 215));
  } else if (k > 0.78 && k < 0.92) {
    ground = random_color(rng, {10, 90}, {170, 220}, {210, 255});  // yellow
  } else if (k >= 0.92) {
    ground = random_color(rng, {30, 255}, {30, 255}, {30, 255});
  } else {
    for (int c = 0; c < 3; ++c) ground[c] = std::clamp(ground[c] + rng.normal(0, 6), 150.0, 255.0);
  }
  const double grey = (ground[0] + ground[1] + ground[2]) / 3;
  Color ink = Color::all(rng.uniform(5, 60));
  if (rng.uniform() < (kind == PlateKind::kUs ? 0.45 : 0.12)) {  // blue, red, green
    ink = random_color(rng, {0, 60}, {0, 60}, {0, 60});
    ink[rng.integer(0, 2)] += rng.uniform(40, 130);
  }
  if (grey < 120 || rng.uniform() < 0.05) {  // light on dark
    if (grey >= 120) ground = random_color(rng, {5, 110}, {5, 80}, {5, 110});
    ink = Color::all(rng.uniform(190, 255));
  }
  style.ground = style.ground_below = ground;
  style.ink = ink;
  if (kind == PlateKind::kUs && rng.uniform() < 0.4) {  // a gradient between two colours
    for (int c = 0; c < 3; ++c)
      style.ground_below[c] = std::clamp(ground[c] + rng.normal(0, 45), 0.0, 255.0);
  }
}

void vary(PlateStyle& style, PlateKind kind, const GlyphSet& glyphs, Rng& rng) {
  vary_colors(style, kind, rng);
  style.typeface = glyphs.pick(rng);
  style.weight =
      std::clamp(static_cast<int>(std::lround(rng.normal(1.8, 1.1))), 0, GlyphSet::kWeights - 1);
  style.cap_height *= rng.uniform(0.92, 1.08);
  style.digit_width *= rng.uniform(0.8, 1.12);
  style.gap *= rng.uniform(0.5, 1.3);
  style.group_gap *= rng.uniform(0.5, 1.2);
  style.centre += rng.normal(0, 0.015);
  style.fixed_pitch = rng.uniform() < 0.6;
  style.w_width = rng.uniform(0.98, 1.35);
  style.slant = rng.uniform() < 0.12 ? rng.normal(0, 0.08) : 0;
  style.inverted_w = rng.uniform() < (kind == PlateKind::kUs ? 0.6 : 0.3);
  style.border = rng.uniform() < 0.6 ? rng.uniform(1, 6) : 0;
  style.corner = rng.uniform(0, 14);
  style.band = random_color(rng, {90, 200}, {20, 90}, {0, 60});
  if (rng.uniform() < 0.1) style.band = random_color(rng, {0, 255}, {0, 255}, {0, 255});
  if (kind == PlateKind::kEurope) {
    style.band_left = rng.uniform() < 0.75 ? rng.uniform(32, 46) : 0;
    style.band_right = rng.uniform() < 0.12 ? rng.uniform(32, 46) : 0;
    style.width = rng.uniform() < 0.85 ? 520 : rng.uniform(380, 500);
    if (rng.uniform() < 0.08) {
      style.ink = Color(0, 0, rng.uniform(120, 190));  // Belgium
    }
  }
  if (kind == PlateKind::kSpain && rng.uniform() < 0.06) style.band_left = 0;
}

// Bright plate, dark ink; colours are lost, and coloured print is bright as well.
void in_infrared(PlateStyle& style, Rng& rng) {
  style.ground = style.ground_below = Color::all(rng.uniform(205, 255));
  style.ink = Color::all(rng.uniform(5, 55));
  style.band = Color::all(rng.uniform(120, 220));
}

// --- the text ---

struct Cell {
  char symbol;
  double width;  // mm, of the ink
  double room;   // mm, including its spacing
  double left;   // mm
};

struct Line {
  std::vector<Cell> cells;
  struct Gap {
    double x;
    double room;
  };
  std::vector<Gap> gaps;
};

Line lay_out(const std::string& groups, const PlateStyle& style, const GlyphSet& glyphs,
             double from, double to) {
  const double stretch = style.digit_width / style.cap_height /
                         glyphs.typefaces()[static_cast<std::size_t>(style.typeface)].digit_aspect;
  Line line;
  double width = 0;
  std::vector<std::size_t> breaks;
  for (const char c : groups) {
    if (c == ' ') {
      breaks.push_back(line.cells.size());
      width += style.group_gap - style.gap;
      continue;
    }
    Cell cell{};
    cell.symbol = c;
    const cv::Mat mask = letter_of(glyphs, style, c);
    cell.width = std::min(style.cap_height * stretch * mask.cols / mask.rows,
                          style.digit_width * style.w_width);
    cell.room = style.fixed_pitch ? std::max(style.digit_width, cell.width) : cell.width;
    width += cell.room + style.gap;
    line.cells.push_back(cell);
  }
  width -= style.gap;
  const double squeeze = std::min(1.0, (to - from) / width);
  double x = (from + to) / 2 - width * squeeze / 2;
  std::size_t next = 0;
  for (std::size_t i = 0; i < line.cells.size(); ++i) {
    if (next < breaks.size() && breaks[next] == i) {
      const double room = (style.group_gap - style.gap) * squeeze;
      line.gaps.push_back({x + room / 2 - style.gap * squeeze / 2, room + style.gap * squeeze});
      x += room;
      ++next;
    }
    Cell& cell = line.cells[i];
    cell.width *= squeeze;
    cell.room *= squeeze;
    cell.left = x + (cell.room - cell.width) / 2;
    x += cell.room + style.gap * squeeze;
  }
  return line;
}

void letter(const PlatePainter& p, const PlateStyle& style, const Line& line, double y, int row,
            bool embossed, PlateFace& face) {
  for (const Cell& cell : line.cells) {
    const cv::Mat source = letter_of(p.glyphs, style, cell.symbol);
    const cv::Size size(std::max(2, p.px(cell.width)), std::max(4, p.px(style.cap_height)));
    cv::Mat mask;
    cv::resize(source, mask, size, 0, 0, cv::INTER_AREA);
    mask = slanted(mask, style.slant);
    if (style.max_wear > 0) wear(mask, style.max_wear, p.rng);
    const cv::Point corner = p.at(cell.left, y - style.cap_height / 2);
    if (embossed && p.s > 0.5) {
      blend(p.image, mask * 0.5, corner + cv::Point(-1, -1), Color::all(255));
      blend(p.image, mask * 0.35, corner + cv::Point(1, 1), Color::all(60));
    }
    if (style.relief > 0) relief(p, style, mask, corner);
    blend(p.image, mask, corner, style.ink);
    face.symbols.push_back(
        {cell.symbol,
         {static_cast<float>(corner.x) - 0.5F, static_cast<float>(corner.y) - 0.5F,
          static_cast<float>(mask.cols), static_cast<float>(mask.rows)},
         row});
  }
}

void paint_ground(cv::Mat& image, const PlateStyle& style) {
  for (int y = 0; y < image.rows; ++y) {
    const double t = static_cast<double>(y) / image.rows;
    image.row(y).setTo(style.ground * (1 - t) + style.ground_below * t);
  }
}

PlateSeparator choose_separator(PlateKind kind, bool random, Rng& rng) {
  if (kind == PlateKind::kSpain || kind == PlateKind::kSpainSquare ||
      kind == PlateKind::kSpainMoto) {
    return PlateSeparator::kNone;
  }
  if (kind == PlateKind::kSpainOld) return PlateSeparator::kDash;
  if (!random) return kind == PlateKind::kBrazil ? PlateSeparator::kDash : PlateSeparator::kNone;
  constexpr PlateSeparator kAll[] = {PlateSeparator::kNone,   PlateSeparator::kDash,
                                     PlateSeparator::kDash,   PlateSeparator::kDot,
                                     PlateSeparator::kSeal,   PlateSeparator::kSeals,
                                     PlateSeparator::kSeals,  PlateSeparator::kEmblem,
                                     PlateSeparator::kEmblem, PlateSeparator::kDashAndSeal};
  // Most European plates have a separator between the groups, fewer American ones.
  if (kind != PlateKind::kEurope && rng.uniform() < 0.3) return PlateSeparator::kNone;
  return kAll[static_cast<std::size_t>(rng.integer(0, 9))];
}

}  // namespace

PlateFace render_plate_face(const GlyphSet& glyphs, const PlateFaceOptions& options, Rng& rng) {
  options.check();
  const std::vector<std::string> rows =
      plate_text(options.kind, options.text, options.any_text, rng);
  PlateStyle style = standard_style(options.kind, static_cast<int>(rows.size()));
  const bool wild = options.random_style && options.wild;
  if (options.random_style) vary(style, options.kind, glyphs, rng);
  // American and Brazilian plates have lines above and below anyway.
  const bool lined = options.kind == PlateKind::kUs || options.kind == PlateKind::kBrazil;
  if (wild) make_wild(style, rows.size() == 1 && !lined, rng);
  if (options.infrared) in_infrared(style, rng);
  const auto s = static_cast<double>(options.px_per_mm);
  PlateFace face;
  face.rows = static_cast<int>(rows.size());
  face.image.create(cvRound(style.height * s), cvRound(style.width * s), CV_8UC3);
  paint_ground(face.image, style);
  const PlatePainter p{face.image, s, glyphs, rng};
  const bool random = options.random_style;
  if (style.lattice > 0) lattice(p, style);
  euro_band(p, style, true);
  euro_band(p, style, false);
  if (options.kind == PlateKind::kUs && random && !options.infrared) us_ornaments(p, style);
  if (options.kind == PlateKind::kBrazil) {
    if (random && rng.uniform() < 0.5) {  // Mercosur's blue head
      cv::rectangle(face.image, cv::Rect({0, 0}, p.at(style.width, 28)), style.band, cv::FILLED);
      small_text(p, "BRASIL", style.width / 2, 14, 14, {250, 250, 250});
    } else {
      const std::string second = random_word(rng, 4, 10);
      const std::string first = random_word(rng, 2, 2);
      small_text(p, first + " " + second, style.width / 2, 17, 14, style.ink);
    }
  }
  if (style.border > 0) {
    cv::rectangle(face.image, cv::Rect(0, 0, face.image.cols, face.image.rows), style.ink,
                  std::max(1, p.px(style.border)));
  }
  slogans(p, style);
  if (wild && !options.infrared && rng.uniform() < (options.kind == PlateKind::kUs ? 0.3 : 0.05)) {
    const double across = style.width * rng.uniform(0.05, 0.95);
    ghost(p, style, across, style.height * style.centre);
  }
  PlateSeparator between = choose_separator(options.kind, random, rng);
  if (wild && rng.uniform() < (options.kind == PlateKind::kBrazil ? 0.5 : 0.1))
    between = PlateSeparator::kDot;
  if (wild && rng.uniform() < 0.2) between = PlateSeparator::kEmblem;
  const bool embossed = random && rng.uniform() < 0.4;
  const double margin = options.kind == PlateKind::kUs ? 10 : 14;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    double y = style.height * style.centre;
    double from = style.band_left + margin;
    const double to = style.width - style.band_right - margin;
    if (rows.size() == 2) {
      y = style.height * (row == 0 ? 0.26 : 0.74);
      if (row == 1) from = margin;
    }
    // Sometimes a shield or image before or after the text.
    double until = to;
    if (random && rows.size() == 1 && rng.uniform() < (wild ? 0.3 : 0.22)) {
      const double room = rng.uniform(22, 42) * style.width / 520 + 8;
      const bool before = rng.uniform() < 0.7;
      const double x = before ? from + room / 2 - 6 : to - room / 2 + 6;
      const double at = y + rng.normal(0, style.cap_height * 0.12);
      separator(p, style, rng.uniform() < 0.3 ? PlateSeparator::kSeals : PlateSeparator::kEmblem, x,
                at, room);
      if (rng.uniform() < 0.4)
        small_text(p, random_word(rng, 1, 3), x, y + style.cap_height * 0.38,
                   style.cap_height * 0.2, style.ink);
      if (before)
        from += room;
      else
        until -= room;
    }
    if (style.has_stacked_letters && rows.size() == 1) {
      if (rng.uniform() < 0.6)
        from += stacked_letters(p, style, from + style.cap_height * 0.18, y) + style.gap;
      else
        until -= stacked_letters(p, style, until - style.cap_height * 0.18, y) + style.gap;
    }
    if (style.has_side_symbols && rows.size() == 1) {
      if (rng.uniform() < 0.4)
        from += side_symbols(p, style, from, y, false) + style.gap;
      else
        until -= side_symbols(p, style, until, y, true) + style.gap;
    }
    const Line line = lay_out(rows[row], style, glyphs, from, until);
    for (const Line::Gap& gap : line.gaps) separator(p, style, between, gap.x, y, gap.room);
    letter(p, style, line, y, static_cast<int>(row), embossed, face);
  }
  for (const PlateSymbol& symbol : face.symbols) face.text += symbol.symbol;
  if (random) {
    if (rng.uniform() < 0.35) rivets(p, style);
    if (rng.uniform() < 0.25) dirt(p, style);
    if (rng.uniform() < (options.kind == PlateKind::kUs ? 0.4 : 0.2) && rows.size() == 1)
      dealer_frame(p, style);
  }
  if (options.infrared) {
    cv::Mat gray;
    cv::cvtColor(face.image, gray, cv::COLOR_BGR2GRAY);
    cv::cvtColor(gray, face.image, cv::COLOR_GRAY2BGR);
  }
  return face;
}

}  // namespace tarsier::synth
