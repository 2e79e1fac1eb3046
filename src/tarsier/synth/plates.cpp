// SPDX-License-Identifier: MIT
#include "tarsier/synth/plates.h"

#include "tarsier/core/require.h"
#include "tarsier/synth/glyphs.h"
#include "tarsier/synth/plate_texts.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

namespace tarsier::synth {
namespace {

using Color = cv::Scalar;  // BGR

// What a plate looks like, in mm and colours; filled by the kind's style.
struct Look {
  double width = 520;
  double height = 110;
  double cap = 77;          // height of a character
  double cell = 43;         // width of a digit
  double gap = 14;          // between characters
  double group_gap = 41;    // between groups
  double centre = 0.5;      // of the text, share of the height
  bool fixed_pitch = true;  // a 1 takes as much room as an 8
  double widest = 1.35;     // of a W by a digit's
  bool turned_w = false;    // the W is an M upside down, as in many dies for one width
  double band_left = 0;     // width of the euro band
  double band_right = 0;
  double corner = 8;  // radius
  double border = 2;  // line along the edge
  Color ground{250, 250, 250};
  Color ground_below{250, 250, 250};
  Color ink{25, 20, 20};
  Color band{150, 50, 10};
  int typeface = 0;
  int weight = 2;
  double slant = 0;
};

struct Painter {
  cv::Mat& image;
  double s;  // px per mm
  const GlyphSet& glyphs;
  Rng& rng;

  [[nodiscard]] int px(double mm) const { return cvRound(mm * s); }
  [[nodiscard]] cv::Point at(double x, double y) const { return {px(x), px(y)}; }

  [[nodiscard]] Color any_color() const {
    return {rng.uniform(0, 255), rng.uniform(0, 255), rng.uniform(0, 255)};
  }
  [[nodiscard]] bool chance(double p) const { return rng.uniform() < p; }
};

// Blends `color` over the picture where `mask` covers it.
void blend(cv::Mat& image, const cv::Mat& mask, cv::Point corner, const Color& color) {
  const cv::Rect where = cv::Rect(corner, mask.size()) & cv::Rect(0, 0, image.cols, image.rows);
  const int b = cvRound(color[0]);
  const int g = cvRound(color[1]);
  const int r = cvRound(color[2]);
  for (int y = where.y; y < where.y + where.height; ++y) {
    const std::uint8_t* a = mask.ptr(y - corner.y) + (where.x - corner.x);
    std::uint8_t* p = image.ptr(y) + static_cast<std::ptrdiff_t>(where.x) * 3;
    for (int x = 0; x < where.width; ++x, p += 3) {
      const int alpha = a[x];
      if (alpha == 0) continue;
      p[0] = static_cast<std::uint8_t>(p[0] + (b - p[0]) * alpha / 255);
      p[1] = static_cast<std::uint8_t>(p[1] + (g - p[1]) * alpha / 255);
      p[2] = static_cast<std::uint8_t>(p[2] + (r - p[2]) * alpha / 255);
    }
  }
}

cv::Mat slanted(const cv::Mat& mask, double slant) {
  if (std::abs(slant) < 0.01) return mask;
  const double shift = std::abs(slant) * mask.rows;
  const cv::Mat map = (cv::Mat_<double>(2, 3) << 1, -slant, slant > 0 ? shift : 0, 0, 1, 0);
  cv::Mat result;
  cv::warpAffine(mask, result, map, {mask.cols + cvRound(shift), mask.rows});
  return result;
}

const cv::Mat& mask_of(const GlyphSet& glyphs, char symbol, int typeface, int weight) {
  const auto& face = glyphs.typefaces()[static_cast<std::size_t>(typeface)];
  const std::size_t index = kPlateSymbols.find(symbol);
  return face.masks[static_cast<std::size_t>(weight)][index == std::string_view::npos ? 0 : index];
}

// The symbol as this plate letters it.
cv::Mat letter_of(const GlyphSet& glyphs, const Look& look, char symbol) {
  if (symbol == 'W' && look.turned_w) {
    cv::Mat turned;
    cv::flip(mask_of(glyphs, 'M', look.typeface, look.weight), turned, 0);
    return turned;
  }
  return mask_of(glyphs, symbol, look.typeface, look.weight);
}

// A line of small lettering, centred; returns its width in mm.
double small_text(const Painter& p, const std::string& text, double x, double y, double height,
                  const Color& color, double stretch = 1) {
  const int typeface = p.rng.integer(0, static_cast<int>(p.glyphs.typefaces().size()) - 1);
  double width = 0;
  std::vector<double> widths;
  for (const char c : text) {
    const double w =
        c == ' ' ? height * 0.5
                 : height * stretch * mask_of(p.glyphs, c, typeface, 2).cols / GlyphSet::kCapHeight;
    widths.push_back(w);
    width += w + height * 0.18;
  }
  double left = x - width / 2;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != ' ' && p.px(height) >= 2) {
      const cv::Size size(std::max(1, p.px(widths[i])), p.px(height));
      cv::Mat mask;
      cv::resize(mask_of(p.glyphs, text[i], typeface, 2), mask, size, 0, 0, cv::INTER_AREA);
      blend(p.image, mask, p.at(left, y - height / 2), color);
    }
    left += widths[i] + height * 0.18;
  }
  return width;
}

std::string random_word(Rng& rng, int least, int most) {
  std::string word;
  for (int i = rng.integer(least, most); i > 0; --i)
    word += kPlateSymbols[static_cast<std::size_t>(rng.integer(10, 35))];
  return word;
}

// --- ornaments ---

void euro_band(const Painter& p, const Look& look, bool left) {
  const double width = left ? look.band_left : look.band_right;
  if (width <= 0) return;
  const double x0 = left ? 0 : look.width - width;
  const double tall = look.height;
  cv::rectangle(p.image, cv::Rect(p.at(x0, 0), p.at(x0 + width, tall)), look.band, cv::FILLED);
  const double middle = x0 + width / 2;
  const Color star(60, 220, 240);
  const double ring = std::min(width * 0.32, tall * 0.18);
  for (int i = 0; i < 12; ++i) {
    const double a = i * CV_PI / 6;
    cv::circle(p.image, p.at(middle + ring * std::cos(a), tall * 0.32 + ring * std::sin(a)),
               std::max(1, p.px(ring * 0.14)), star, cv::FILLED, cv::LINE_AA);
  }
  const std::string letters = random_word(p.rng, 1, p.chance(0.5) ? 1 : 3);
  const double cap = std::min(26.0, width * 0.9 / static_cast<double>(letters.size()) * 1.2);
  small_text(p, letters, middle, tall * 0.76, cap, {240, 240, 240}, 0.9);
}

void disc(const Painter& p, double x, double y, double radius) {
  const Color color = p.any_color();
  cv::circle(p.image, p.at(x, y), std::max(1, p.px(radius)), color, cv::FILLED, cv::LINE_AA);
  if (p.chance(0.6))
    cv::circle(p.image, p.at(x, y), std::max(1, p.px(radius * 0.6)), p.any_color(), cv::FILLED,
               cv::LINE_AA);
}

// A shield, a blob, a star: whatever stands between groups.
void emblem(const Painter& p, double x, double y, double radius) {
  const Color color = p.any_color();
  const double kind = p.rng.uniform();
  if (kind < 0.25) {  // a shield with a cross
    const std::vector<cv::Point> shield{
        p.at(x - radius * 0.8, y - radius), p.at(x + radius * 0.8, y - radius),
        p.at(x + radius * 0.75, y + radius * 0.2), p.at(x, y + radius * 1.1),
        p.at(x - radius * 0.75, y + radius * 0.2)};
    cv::fillPoly(p.image, std::vector<std::vector<cv::Point>>{shield}, color, cv::LINE_AA);
    const Color bright = p.chance(0.7) ? Color::all(245) : p.any_color();
    const int width = std::max(1, p.px(radius * 0.22));
    cv::line(p.image, p.at(x, y - radius * 0.7), p.at(x, y + radius * 0.5), bright, width,
             cv::LINE_AA);
    cv::line(p.image, p.at(x - radius * 0.4, y - radius * 0.3),
             p.at(x + radius * 0.4, y - radius * 0.3), bright, width, cv::LINE_AA);
    return;
  }
  if (kind < 0.5) {  // strokes: a tree, a bird, a signature
    for (int i = p.rng.integer(2, 6); i > 0; --i) {
      const auto any = [&] { return p.rng.uniform(-radius, radius); };
      cv::ellipse(p.image, p.at(x + any() * 0.5, y + any() * 0.5),
                  {std::max(1, p.px(radius * p.rng.uniform(0.2, 0.9))),
                   std::max(1, p.px(radius * p.rng.uniform(0.2, 0.9)))},
                  p.rng.uniform(0, 360), 0, p.rng.uniform(90, 360), color,
                  p.chance(0.4) ? cv::FILLED : std::max(1, p.px(radius * 0.2)), cv::LINE_AA);
    }
    return;
  }
  std::vector<cv::Point> points;
  const int corners = p.rng.integer(4, 11);
  for (int i = 0; i < corners; ++i) {
    const double a = 2 * CV_PI * i / corners;
    const double r = radius * p.rng.uniform(0.45, 1.15);
    points.push_back(p.at(x + r * std::cos(a), y + r * std::sin(a)));
  }
  cv::fillPoly(p.image, std::vector<std::vector<cv::Point>>{points}, color, cv::LINE_AA);
  if (p.chance(0.4)) disc(p, x, y, radius * 0.5);
}

enum class Separator { kNone, kDash, kDot, kSeal, kSeals, kEmblem, kDashAndSeal };

void separator(const Painter& p, const Look& look, Separator kind, double x, double y,
               double room) {
  const double radius = std::clamp(room * 0.36, 4.0, look.cap * 0.2);
  const auto dash = [&] {
    const double half = std::clamp(room * 0.28, 3.0, 11.0);
    cv::rectangle(p.image, cv::Rect(p.at(x - half, y - 4), p.at(x + half, y + 4)), look.ink,
                  cv::FILLED);
  };
  switch (kind) {
    case Separator::kNone:
      break;
    case Separator::kDash:
      dash();
      break;
    case Separator::kDot:
      cv::circle(p.image, p.at(x, y), std::max(1, p.px(5)), look.ink, cv::FILLED, cv::LINE_AA);
      break;
    case Separator::kSeal:
      disc(p, x, y, radius);
      break;
    case Separator::kSeals:
      disc(p, x, y - look.cap * 0.27, radius * 0.95);
      disc(p, x, y + look.cap * 0.24, radius);
      break;
    case Separator::kEmblem:
      emblem(p, x, y, radius * 1.3);
      break;
    case Separator::kDashAndSeal:
      dash();
      disc(p, x, y + (p.chance(0.5) ? -1 : 1) * look.cap * 0.3, radius * 0.8);
      break;
  }
}

void rivets(const Painter& p, const Look& look) {
  const int count = p.rng.integer(1, 4);
  const double inset = p.rng.uniform(8, 30);
  for (int i = 0; i < count; ++i) {
    const bool level = p.chance(0.5);
    const double x = i % 2 == 0 ? look.band_left + inset : look.width - look.band_right - inset;
    const double y = level ? look.height / 2 : (i < 2 ? 14 : look.height - 14);
    const double radius = p.rng.uniform(3, 7);
    const double tone = p.rng.uniform(20, 230);
    cv::circle(p.image, p.at(x, y), std::max(1, p.px(radius)), Color::all(tone), cv::FILLED,
               cv::LINE_AA);
    if (p.chance(0.5))
      cv::circle(p.image, p.at(x - 1, y - 1), std::max(1, p.px(radius * 0.4)),
                 Color::all(std::min(255.0, tone + 70)), cv::FILLED, cv::LINE_AA);
  }
}

void dirt(const Painter& p, const Look& look) {
  for (int i = p.rng.integer(1, 12); i > 0; --i) {
    const Color brown(p.rng.uniform(20, 110), p.rng.uniform(30, 130), p.rng.uniform(40, 150));
    const double x = p.rng.uniform(0, look.width);
    const double y = p.rng.uniform(0, look.height);
    const cv::Size axes(std::max(1, p.px(p.rng.uniform(1, 12))),
                        std::max(1, p.px(p.rng.uniform(1, 7))));
    cv::Mat mask(2 * axes.height + 3, 2 * axes.width + 3, CV_8UC1, Color(0));
    cv::ellipse(mask, {axes.width + 1, axes.height + 1}, axes, 0, 0, 360,
                Color(p.rng.uniform(40, 200)), cv::FILLED);
    blend(p.image, mask, p.at(x, y), brown);
  }
  if (p.chance(0.3)) {
    const double tone = p.rng.uniform(60, 230);
    cv::line(p.image, p.at(p.rng.uniform(0, look.width), p.rng.uniform(0, look.height)),
             p.at(p.rng.uniform(0, look.width), p.rng.uniform(0, look.height)), Color::all(tone), 1,
             cv::LINE_AA);
  }
}

// A frame that laps over the plate's edge, with the dealer's name.
void dealer_frame(const Painter& p, const Look& look) {
  const double tone = p.chance(0.7) ? p.rng.uniform(5, 70) : p.rng.uniform(120, 240);
  const Color frame = Color::all(tone);
  const Color letters = tone < 100 ? Color::all(p.rng.uniform(160, 255)) : p.any_color();
  const double side = p.rng.uniform(2, 7);
  const double lower = p.rng.uniform(5, look.height * 0.12);
  const double upper = p.rng.uniform(2, look.height * (look.height > 130 ? 0.14 : 0.06));
  const auto bar = [&](double x0, double y0, double x1, double y1) {
    cv::rectangle(p.image, cv::Rect(p.at(x0, y0), p.at(x1, y1)), frame, cv::FILLED);
  };
  bar(0, 0, side, look.height);
  bar(look.width - side, 0, look.width, look.height);
  bar(0, 0, look.width, upper);
  bar(0, look.height - lower, look.width, look.height);
  for (const bool below : {true, false}) {
    const double strip = below ? lower : upper;
    if (strip < 6 || p.chance(0.25)) continue;
    std::string words = random_word(p.rng, 3, 9) + " " + random_word(p.rng, 2, 9);
    small_text(p, words, look.width / 2, below ? look.height - strip / 2 : strip / 2, strip * 0.65,
               letters, p.rng.uniform(0.8, 1.6));
  }
}

void us_ornaments(const Painter& p, const Look& look) {
  if (p.chance(0.3)) {  // a picture in the background
    for (int i = p.rng.integer(1, 6); i > 0; --i) {
      cv::Mat mask(p.px(60) + 1, p.px(90) + 1, CV_8UC1, Color(0));
      cv::ellipse(mask, {mask.cols / 2, mask.rows / 2},
                  {std::max(1, mask.cols * p.rng.integer(10, 50) / 100),
                   std::max(1, mask.rows * p.rng.integer(10, 50) / 100)},
                  p.rng.uniform(0, 180), 0, 360, Color(p.rng.uniform(20, 110)), cv::FILLED);
      blend(p.image, mask, p.at(p.rng.uniform(-30, look.width), p.rng.uniform(-20, look.height)),
            p.any_color());
    }
  }
  if (p.chance(0.85)) {  // the state
    const Color color = p.chance(0.5) ? look.ink : p.any_color();
    if (p.chance(0.4)) {  // in script
      cv::putText(p.image, random_word(p.rng, 1, 1) + "alifornia", p.at(look.width * 0.3, 24),
                  cv::FONT_HERSHEY_SCRIPT_SIMPLEX, std::max(0.2, 0.8 * p.s), color,
                  std::max(1, p.px(2)), cv::LINE_AA);
    } else {
      small_text(p, random_word(p.rng, 4, 12), look.width * p.rng.uniform(0.4, 0.6),
                 p.rng.uniform(13, 22), p.rng.uniform(9, 20), color, p.rng.uniform(0.8, 1.5));
    }
  }
  if (p.chance(0.6)) {
    small_text(p, random_word(p.rng, 3, 9) + " " + random_word(p.rng, 3, 9), look.width / 2,
               look.height - p.rng.uniform(8, 16), p.rng.uniform(6, 13), p.any_color(),
               p.rng.uniform(0.8, 1.4));
  }
  for (const double x : {28.0, look.width - 28}) {  // month and year
    if (!p.chance(0.45)) continue;
    const double y = p.chance(0.7) ? 17 : look.height - 16;
    const Color sticker = p.any_color();
    cv::rectangle(p.image, cv::Rect(p.at(x - 16, y - 9), p.at(x + 16, y + 9)), sticker, cv::FILLED);
    small_text(p, random_word(p.rng, 2, 3), x, y, 9, Color::all(p.rng.uniform(0, 255)));
  }
  for (const double y : {14.0, look.height - 14}) {  // bolts
    if (!p.chance(0.5)) continue;
    for (const double x : {66.0, look.width - 66}) {
      if (!p.chance(0.8)) continue;
      const double tone = p.rng.uniform(20, 240);
      cv::circle(p.image, p.at(x, y), std::max(1, p.px(6)), Color::all(tone), cv::FILLED,
                 cv::LINE_AA);
      cv::circle(p.image, p.at(x, y), std::max(1, p.px(3)), Color::all(255 - tone), 1, cv::LINE_AA);
    }
  }
}

// --- styles ---

Look standard_look(PlateKind kind, int rows) {
  Look look;
  switch (kind) {
    case PlateKind::kSpain:
    case PlateKind::kEurope:
      look.band_left = 40;
      break;
    case PlateKind::kSpainOld:
      look.group_gap = 30;
      look.cell = 40;
      break;
    case PlateKind::kSpainSquare:
      look.width = 340;
      look.height = 220;
      look.band_left = 40;
      break;
    case PlateKind::kSpainMoto:
      look.width = 220;
      look.height = 160;
      look.cap = 56;
      look.cell = 32;
      look.gap = 10;
      look.band_left = 30;
      break;
    case PlateKind::kUs:
      look.width = 305;
      look.height = 152;
      look.cap = 66;
      look.cell = 32;
      look.gap = 8;
      look.group_gap = 24;
      look.centre = 0.53;
      look.corner = 12;
      look.border = 0;
      break;
    case PlateKind::kBrazil:
      look.width = 400;
      look.height = 130;
      look.cap = 63;
      look.cell = 38;
      look.gap = 9;
      look.group_gap = 26;
      look.centre = 0.6;
      look.ground = look.ground_below = Color(190, 190, 190);
      break;
  }
  if (rows == 2 && kind == PlateKind::kUs) {
    look.width = 178;
    look.height = 102;
    look.cap = 36;
    look.cell = 20;
  }
  return look;
}

void vary_colors(Look& look, PlateKind kind, Rng& rng) {
  const double k = rng.uniform();
  const double lightness = rng.uniform(200, 255);
  Color ground(lightness, lightness, lightness);
  if (kind == PlateKind::kBrazil && k < 0.6) {
    ground = Color::all(rng.uniform(150, 215));
  } else if (k > 0.78 && k < 0.92) {
    ground = Color(rng.uniform(10, 90), rng.uniform(170, 220), rng.uniform(210, 255));  // yellow
  } else if (k >= 0.92) {
    ground = Color(rng.uniform(30, 255), rng.uniform(30, 255), rng.uniform(30, 255));
  } else {
    for (int c = 0; c < 3; ++c) ground[c] = std::clamp(ground[c] + rng.normal(0, 6), 150.0, 255.0);
  }
  const double grey = (ground[0] + ground[1] + ground[2]) / 3;
  Color ink = Color::all(rng.uniform(5, 60));
  if (rng.uniform() < (kind == PlateKind::kUs ? 0.45 : 0.12)) {  // blue, red, green
    ink = Color(rng.uniform(0, 60), rng.uniform(0, 60), rng.uniform(0, 60));
    ink[rng.integer(0, 2)] += rng.uniform(40, 130);
  }
  if (grey < 120 || rng.uniform() < 0.05) {  // light on dark
    if (grey >= 120) ground = Color(rng.uniform(5, 110), rng.uniform(5, 80), rng.uniform(5, 110));
    ink = Color::all(rng.uniform(190, 255));
  }
  look.ground = look.ground_below = ground;
  look.ink = ink;
  if (kind == PlateKind::kUs && rng.uniform() < 0.4) {  // one colour fades into another
    for (int c = 0; c < 3; ++c)
      look.ground_below[c] = std::clamp(ground[c] + rng.normal(0, 45), 0.0, 255.0);
  }
}

void vary(Look& look, PlateKind kind, const GlyphSet& glyphs, Rng& rng) {
  vary_colors(look, kind, rng);
  look.typeface = rng.integer(0, static_cast<int>(glyphs.typefaces().size()) - 1);
  look.weight =
      std::clamp(static_cast<int>(std::lround(rng.normal(1.8, 1.1))), 0, GlyphSet::kWeights - 1);
  look.cap *= rng.uniform(0.92, 1.08);
  look.cell *= rng.uniform(0.8, 1.12);
  look.gap *= rng.uniform(0.5, 1.3);
  look.group_gap *= rng.uniform(0.5, 1.2);
  look.centre += rng.normal(0, 0.015);
  look.fixed_pitch = rng.uniform() < 0.6;
  look.widest = rng.uniform(0.98, 1.35);
  look.slant = rng.uniform() < 0.12 ? rng.normal(0, 0.08) : 0;
  look.turned_w = rng.uniform() < (kind == PlateKind::kUs ? 0.6 : 0.3);
  look.border = rng.uniform() < 0.6 ? rng.uniform(1, 6) : 0;
  look.corner = rng.uniform(0, 14);
  look.band = Color(rng.uniform(90, 200), rng.uniform(20, 90), rng.uniform(0, 60));
  if (rng.uniform() < 0.1)
    look.band = Color(rng.uniform(0, 255), rng.uniform(0, 255), rng.uniform(0, 255));
  if (kind == PlateKind::kEurope) {
    look.band_left = rng.uniform() < 0.75 ? rng.uniform(32, 46) : 0;
    look.band_right = rng.uniform() < 0.12 ? rng.uniform(32, 46) : 0;
    look.width = rng.uniform() < 0.85 ? 520 : rng.uniform(380, 500);
    if (rng.uniform() < 0.08) {
      look.ink = Color(0, 0, rng.uniform(120, 190));  // Belgium
    }
  }
  if (kind == PlateKind::kSpain && rng.uniform() < 0.06) look.band_left = 0;
}

// Bright plate, dark ink; colour is gone, and what is printed in colour shines as well.
void in_infrared(Look& look, Rng& rng) {
  look.ground = look.ground_below = Color::all(rng.uniform(205, 255));
  look.ink = Color::all(rng.uniform(5, 55));
  look.band = Color::all(rng.uniform(120, 220));
}

// --- the text ---

struct Cell {
  char symbol;
  double width;  // mm, of the ink
  double room;   // mm, of its place
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

Line lay_out(const std::string& groups, const Look& look, const GlyphSet& glyphs, double from,
             double to) {
  const double stretch = look.cell / look.cap /
                         glyphs.typefaces()[static_cast<std::size_t>(look.typeface)].digit_aspect;
  Line line;
  double width = 0;
  std::vector<std::size_t> breaks;
  for (const char c : groups) {
    if (c == ' ') {
      breaks.push_back(line.cells.size());
      width += look.group_gap - look.gap;
      continue;
    }
    Cell cell{};
    cell.symbol = c;
    const cv::Mat mask = letter_of(glyphs, look, c);
    cell.width = std::min(look.cap * stretch * mask.cols / mask.rows, look.cell * look.widest);
    cell.room = look.fixed_pitch ? std::max(look.cell, cell.width) : cell.width;
    width += cell.room + look.gap;
    line.cells.push_back(cell);
  }
  width -= look.gap;
  const double squeeze = std::min(1.0, (to - from) / width);
  double x = (from + to) / 2 - width * squeeze / 2;
  std::size_t next = 0;
  for (std::size_t i = 0; i < line.cells.size(); ++i) {
    if (next < breaks.size() && breaks[next] == i) {
      const double room = (look.group_gap - look.gap) * squeeze;
      line.gaps.push_back({x + room / 2 - look.gap * squeeze / 2, room + look.gap * squeeze});
      x += room;
      ++next;
    }
    Cell& cell = line.cells[i];
    cell.width *= squeeze;
    cell.room *= squeeze;
    cell.left = x + (cell.room - cell.width) / 2;
    x += cell.room + look.gap * squeeze;
  }
  return line;
}

void letter(const Painter& p, const Look& look, const Line& line, double y, int row, bool embossed,
            PlateFace& face) {
  for (const Cell& cell : line.cells) {
    const cv::Mat source = letter_of(p.glyphs, look, cell.symbol);
    const cv::Size size(std::max(2, p.px(cell.width)), std::max(4, p.px(look.cap)));
    cv::Mat mask;
    cv::resize(source, mask, size, 0, 0, cv::INTER_AREA);
    mask = slanted(mask, look.slant);
    const cv::Point corner = p.at(cell.left, y - look.cap / 2);
    if (embossed && p.s > 0.5) {
      blend(p.image, mask * 0.5, corner + cv::Point(-1, -1), Color::all(255));
      blend(p.image, mask * 0.35, corner + cv::Point(1, 1), Color::all(60));
    }
    blend(p.image, mask, corner, look.ink);
    face.symbols.push_back(
        {cell.symbol,
         {static_cast<float>(corner.x) - 0.5F, static_cast<float>(corner.y) - 0.5F,
          static_cast<float>(mask.cols), static_cast<float>(mask.rows)},
         row});
  }
}

void paint_ground(cv::Mat& image, const Look& look) {
  for (int y = 0; y < image.rows; ++y) {
    const double t = static_cast<double>(y) / image.rows;
    image.row(y).setTo(look.ground * (1 - t) + look.ground_below * t);
  }
}

Separator choose_separator(PlateKind kind, bool random, Rng& rng) {
  if (kind == PlateKind::kSpain || kind == PlateKind::kSpainSquare ||
      kind == PlateKind::kSpainMoto) {
    return Separator::kNone;
  }
  if (kind == PlateKind::kSpainOld) return Separator::kDash;
  if (!random) return kind == PlateKind::kBrazil ? Separator::kDash : Separator::kNone;
  constexpr Separator kAll[] = {Separator::kNone,       Separator::kDash,   Separator::kDash,
                                Separator::kDot,        Separator::kSeal,   Separator::kSeals,
                                Separator::kSeals,      Separator::kEmblem, Separator::kEmblem,
                                Separator::kDashAndSeal};
  // Most European plates have something between the groups, fewer American ones.
  if (kind != PlateKind::kEurope && rng.uniform() < 0.3) return Separator::kNone;
  return kAll[static_cast<std::size_t>(rng.integer(0, 9))];
}

}  // namespace

PlateFace render_plate_face(const GlyphSet& glyphs, const PlateFaceOptions& options, Rng& rng) {
  TARSIER_REQUIRE(options.px_per_mm >= 0.2F && options.px_per_mm <= 4, "px_per_mm {}",
                  options.px_per_mm);
  const std::vector<std::string> rows =
      plate_text(options.kind, options.text, options.any_text, rng);
  Look look = standard_look(options.kind, static_cast<int>(rows.size()));
  if (options.random_style) vary(look, options.kind, glyphs, rng);
  if (options.infrared) in_infrared(look, rng);
  const double s = static_cast<double>(options.px_per_mm);
  PlateFace face;
  face.rows = static_cast<int>(rows.size());
  face.image.create(cvRound(look.height * s), cvRound(look.width * s), CV_8UC3);
  paint_ground(face.image, look);
  const Painter p{face.image, s, glyphs, rng};
  const bool random = options.random_style;
  euro_band(p, look, true);
  euro_band(p, look, false);
  if (options.kind == PlateKind::kUs && random && !options.infrared) us_ornaments(p, look);
  if (options.kind == PlateKind::kBrazil) {
    if (random && rng.uniform() < 0.5) {  // Mercosur's blue head
      cv::rectangle(face.image, cv::Rect({0, 0}, p.at(look.width, 28)), look.band, cv::FILLED);
      small_text(p, "BRASIL", look.width / 2, 14, 14, {250, 250, 250});
    } else {
      small_text(p, random_word(rng, 2, 2) + " " + random_word(rng, 4, 10), look.width / 2, 17, 14,
                 look.ink);
    }
  }
  if (look.border > 0) {
    cv::rectangle(face.image, cv::Rect(0, 0, face.image.cols, face.image.rows), look.ink,
                  std::max(1, p.px(look.border)));
  }
  const Separator between = choose_separator(options.kind, random, rng);
  const bool embossed = random && rng.uniform() < 0.4;
  const double margin = options.kind == PlateKind::kUs ? 10 : 14;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    double y = look.height * look.centre;
    double from = look.band_left + margin;
    const double to = look.width - look.band_right - margin;
    if (rows.size() == 2) {
      y = look.height * (row == 0 ? 0.26 : 0.74);
      if (row == 1) from = margin;
    }
    // A shield or picture that stands before or behind the text, now and then.
    double until = to;
    if (random && rows.size() == 1 && rng.uniform() < 0.22) {
      const double room = rng.uniform(22, 42) * look.width / 520 + 8;
      const bool before = rng.uniform() < 0.7;
      const double x = before ? from + room / 2 - 6 : to - room / 2 + 6;
      separator(p, look, rng.uniform() < 0.3 ? Separator::kSeals : Separator::kEmblem, x,
                y + rng.normal(0, look.cap * 0.12), room);
      if (rng.uniform() < 0.4)
        small_text(p, random_word(rng, 1, 3), x, y + look.cap * 0.38, look.cap * 0.2, look.ink);
      if (before)
        from += room;
      else
        until -= room;
    }
    const Line line = lay_out(rows[row], look, glyphs, from, until);
    for (const Line::Gap& gap : line.gaps) separator(p, look, between, gap.x, y, gap.room);
    letter(p, look, line, y, static_cast<int>(row), embossed, face);
  }
  for (const PlateSymbol& symbol : face.symbols) face.text += symbol.symbol;
  if (random) {
    if (rng.uniform() < 0.35) rivets(p, look);
    if (rng.uniform() < 0.25) dirt(p, look);
    if (rng.uniform() < (options.kind == PlateKind::kUs ? 0.4 : 0.2) && rows.size() == 1)
      dealer_frame(p, look);
  }
  if (options.infrared) {
    cv::Mat gray;
    cv::cvtColor(face.image, gray, cv::COLOR_BGR2GRAY);
    cv::cvtColor(gray, face.image, cv::COLOR_GRAY2BGR);
  }
  return face;
}

}  // namespace tarsier::synth
