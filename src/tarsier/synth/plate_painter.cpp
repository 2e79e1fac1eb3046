// SPDX-License-Identifier: MIT
#include "tarsier/synth/plate_painter.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tarsier::synth {
namespace {

const cv::Mat& mask_of(const GlyphSet& glyphs, char symbol, int typeface, int weight) {
  const std::size_t index = kPlateSymbols.find(symbol);
  return glyphs.mask(typeface, weight, index == std::string_view::npos ? 0 : index);
}

void disc(const PlatePainter& p, double x, double y, double radius) {
  const Color color = p.any_color();
  cv::circle(p.image, p.at(x, y), std::max(1, p.px(radius)), color, cv::FILLED, cv::LINE_AA);
  if (p.with_probability(0.6))
    cv::circle(p.image, p.at(x, y), std::max(1, p.px(radius * 0.6)), p.any_color(), cv::FILLED,
               cv::LINE_AA);
}

// An emblem between groups: a shield, a blob or a star.
void emblem(const PlatePainter& p, double x, double y, double radius) {
  const Color color = p.any_color();
  const double kind = p.rng.uniform();
  if (kind < 0.25) {  // a shield with a cross
    const std::vector<cv::Point> shield{
        p.at(x - radius * 0.8, y - radius), p.at(x + radius * 0.8, y - radius),
        p.at(x + radius * 0.75, y + radius * 0.2), p.at(x, y + radius * 1.1),
        p.at(x - radius * 0.75, y + radius * 0.2)};
    cv::fillPoly(p.image, std::vector<std::vector<cv::Point>>{shield}, color, cv::LINE_AA);
    const Color bright = p.with_probability(0.7) ? Color::all(245) : p.any_color();
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
      const int width = p.with_probability(0.4) ? cv::FILLED : std::max(1, p.px(radius * 0.2));
      const double arc = p.rng.uniform(90, 360);
      const double turn = p.rng.uniform(0, 360);
      const cv::Size axes{std::max(1, p.px(radius * p.rng.uniform(0.2, 0.9))),
                          std::max(1, p.px(radius * p.rng.uniform(0.2, 0.9)))};
      const double down = any() * 0.5;
      const double across = any() * 0.5;
      cv::ellipse(p.image, p.at(x + across, y + down), axes, turn, 0, arc, color, width,
                  cv::LINE_AA);
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
  if (p.with_probability(0.4)) disc(p, x, y, radius * 0.5);
}

}  // namespace

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

cv::Mat letter_of(const GlyphSet& glyphs, const PlateStyle& style, char symbol) {
  if (symbol == 'W' && style.inverted_w) {
    cv::Mat turned;
    cv::flip(mask_of(glyphs, 'M', style.typeface, style.weight), turned, 0);
    return turned;
  }
  return mask_of(glyphs, symbol, style.typeface, style.weight);
}

double small_text(const PlatePainter& p, const std::string& text, double x, double y, double height,
                  const Color& color, double stretch) {
  const int typeface = p.glyphs.pick(p.rng);
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

Color random_color(Rng& rng, ColorRange blue, ColorRange green, ColorRange red) {
  const double r = rng.uniform(red.low, red.high);
  const double g = rng.uniform(green.low, green.high);
  const double b = rng.uniform(blue.low, blue.high);
  return {b, g, r};
}

std::string random_word(Rng& rng, int least, int most) {
  std::string word;
  for (int i = rng.integer(least, most); i > 0; --i)
    word += kPlateSymbols[static_cast<std::size_t>(rng.integer(10, 35))];
  return word;
}

void euro_band(const PlatePainter& p, const PlateStyle& style, bool left) {
  const double width = left ? style.band_left : style.band_right;
  if (width <= 0) return;
  const double x0 = left ? 0 : style.width - width;
  const double tall = style.height;
  cv::rectangle(p.image, cv::Rect(p.at(x0, 0), p.at(x0 + width, tall)), style.band, cv::FILLED);
  const double middle = x0 + width / 2;
  const Color star(60, 220, 240);
  const double ring = std::min(width * 0.32, tall * 0.18);
  for (int i = 0; i < 12; ++i) {
    const double a = i * CV_PI / 6;
    cv::circle(p.image, p.at(middle + ring * std::cos(a), tall * 0.32 + ring * std::sin(a)),
               std::max(1, p.px(ring * 0.14)), star, cv::FILLED, cv::LINE_AA);
  }
  const std::string letters = random_word(p.rng, 1, p.with_probability(0.5) ? 1 : 3);
  const double cap = std::min(26.0, width * 0.9 / static_cast<double>(letters.size()) * 1.2);
  small_text(p, letters, middle, tall * 0.76, cap, {240, 240, 240}, 0.9);
}

void separator(const PlatePainter& p, const PlateStyle& style, PlateSeparator kind, double x,
               double y, double room) {
  const double radius =
      style.emblem > 0 ? std::min(style.emblem * style.cap_height * 0.5, std::max(4.0, room * 0.48))
                       : std::clamp(room * 0.36, 4.0, style.cap_height * 0.2);
  const auto dash = [&] {
    const double half = std::clamp(room * 0.28, 3.0, 11.0);
    cv::rectangle(p.image, cv::Rect(p.at(x - half, y - 4), p.at(x + half, y + 4)), style.ink,
                  cv::FILLED);
  };
  switch (kind) {
    case PlateSeparator::kNone:
      break;
    case PlateSeparator::kDash:
      dash();
      break;
    case PlateSeparator::kDot:
      cv::circle(p.image, p.at(x, y), std::max(1, p.px(5)), style.ink, cv::FILLED, cv::LINE_AA);
      break;
    case PlateSeparator::kSeal:
      disc(p, x, y, radius);
      break;
    case PlateSeparator::kSeals:
      disc(p, x, y - style.cap_height * 0.27, radius * 0.95);
      disc(p, x, y + style.cap_height * 0.24, radius);
      break;
    case PlateSeparator::kEmblem:
      if (style.has_crests)
        crest(p, style, x, y, radius * p.rng.uniform(1, 1.5));
      else
        emblem(p, x, y, radius * 1.3);
      break;
    case PlateSeparator::kDashAndSeal:
      dash();
      disc(p, x, y + (p.with_probability(0.5) ? -1 : 1) * style.cap_height * 0.3, radius * 0.8);
      break;
  }
}

void rivets(const PlatePainter& p, const PlateStyle& style) {
  const int count = p.rng.integer(1, 4);
  const double inset = p.rng.uniform(8, 30);
  for (int i = 0; i < count; ++i) {
    const bool level = p.with_probability(0.5);
    const double x = i % 2 == 0 ? style.band_left + inset : style.width - style.band_right - inset;
    const double y = level ? style.height / 2 : (i < 2 ? 14 : style.height - 14);
    const double radius = p.rng.uniform(3, 7);
    const double tone = p.rng.uniform(20, 230);
    cv::circle(p.image, p.at(x, y), std::max(1, p.px(radius)), Color::all(tone), cv::FILLED,
               cv::LINE_AA);
    if (p.with_probability(0.5))
      cv::circle(p.image, p.at(x - 1, y - 1), std::max(1, p.px(radius * 0.4)),
                 Color::all(std::min(255.0, tone + 70)), cv::FILLED, cv::LINE_AA);
  }
}

void dirt(const PlatePainter& p, const PlateStyle& style) {
  for (int i = p.rng.integer(1, 12); i > 0; --i) {
    const Color brown = random_color(p.rng, {20, 110}, {30, 130}, {40, 150});
    const double x = p.rng.uniform(0, style.width);
    const double y = p.rng.uniform(0, style.height);
    const int high = std::max(1, p.px(p.rng.uniform(1, 7)));
    const cv::Size axes(std::max(1, p.px(p.rng.uniform(1, 12))), high);
    cv::Mat mask(2 * axes.height + 3, 2 * axes.width + 3, CV_8UC1, Color(0));
    cv::ellipse(mask, {axes.width + 1, axes.height + 1}, axes, 0, 0, 360,
                Color(p.rng.uniform(40, 200)), cv::FILLED);
    blend(p.image, mask, p.at(x, y), brown);
  }
  if (p.with_probability(0.3)) {
    const double tone = p.rng.uniform(60, 230);
    const auto any = [&] {
      const double y = p.rng.uniform(0, style.height);
      return p.at(p.rng.uniform(0, style.width), y);
    };
    const cv::Point to = any();
    cv::line(p.image, any(), to, Color::all(tone), 1, cv::LINE_AA);
  }
}

void dealer_frame(const PlatePainter& p, const PlateStyle& style) {
  const double tone = p.with_probability(0.7) ? p.rng.uniform(5, 70) : p.rng.uniform(120, 240);
  const Color frame = Color::all(tone);
  const Color letters = tone < 100 ? Color::all(p.rng.uniform(160, 255)) : p.any_color();
  const double side = p.rng.uniform(2, 7);
  const double lower = p.rng.uniform(5, style.height * 0.12);
  const double upper = p.rng.uniform(2, style.height * (style.height > 130 ? 0.14 : 0.06));
  const auto bar = [&](double x0, double y0, double x1, double y1) {
    cv::rectangle(p.image, cv::Rect(p.at(x0, y0), p.at(x1, y1)), frame, cv::FILLED);
  };
  bar(0, 0, side, style.height);
  bar(style.width - side, 0, style.width, style.height);
  bar(0, 0, style.width, upper);
  bar(0, style.height - lower, style.width, style.height);
  for (const bool below : {true, false}) {
    const double strip = below ? lower : upper;
    if (strip < 6 || p.with_probability(0.25)) continue;
    const std::string second = random_word(p.rng, 2, 9);
    const std::string first = random_word(p.rng, 3, 9);
    small_text(p, first + " " + second, style.width / 2,
               below ? style.height - strip / 2 : strip / 2, strip * 0.65, letters,
               p.rng.uniform(0.8, 1.6));
  }
}

void us_ornaments(const PlatePainter& p, const PlateStyle& style) {
  if (p.with_probability(0.3)) {  // an image in the background
    for (int i = p.rng.integer(1, 6); i > 0; --i) {
      cv::Mat mask(p.px(60) + 1, p.px(90) + 1, CV_8UC1, Color(0));
      const Color strength(p.rng.uniform(20, 110));
      const double turn = p.rng.uniform(0, 180);
      const cv::Size axes{std::max(1, mask.cols * p.rng.integer(10, 50) / 100),
                          std::max(1, mask.rows * p.rng.integer(10, 50) / 100)};
      cv::ellipse(mask, {mask.cols / 2, mask.rows / 2}, axes, turn, 0, 360, strength, cv::FILLED);
      const Color color = p.any_color();
      const double y = p.rng.uniform(-20, style.height);
      blend(p.image, mask, p.at(p.rng.uniform(-30, style.width), y), color);
    }
  }
  if (p.with_probability(0.85)) {  // the state
    const Color color = p.with_probability(0.5) ? style.ink : p.any_color();
    if (p.with_probability(0.4)) {  // in script
      cv::putText(p.image, random_word(p.rng, 1, 1) + "alifornia", p.at(style.width * 0.3, 24),
                  cv::FONT_HERSHEY_SCRIPT_SIMPLEX, std::max(0.2, 0.8 * p.s), color,
                  std::max(1, p.px(2)), cv::LINE_AA);
    } else {
      const double stretch = p.rng.uniform(0.8, 1.5);
      const double cap = p.rng.uniform(9, 20);
      const double y = p.rng.uniform(13, 22);
      const double x = style.width * p.rng.uniform(0.4, 0.6);
      small_text(p, random_word(p.rng, 4, 12), x, y, cap, color, stretch);
    }
  }
  if (p.with_probability(0.6)) {
    const double stretch = p.rng.uniform(0.8, 1.4);
    const Color color = p.any_color();
    const double cap = p.rng.uniform(6, 13);
    const double y = style.height - p.rng.uniform(8, 16);
    const std::string second = random_word(p.rng, 3, 9);
    const std::string first = random_word(p.rng, 3, 9);
    small_text(p, first + " " + second, style.width / 2, y, cap, color, stretch);
  }
  for (const double x : {28.0, style.width - 28}) {  // month and year
    if (!p.with_probability(0.45)) continue;
    const double y = p.with_probability(0.7) ? 17 : style.height - 16;
    const Color sticker = p.any_color();
    cv::rectangle(p.image, cv::Rect(p.at(x - 16, y - 9), p.at(x + 16, y + 9)), sticker, cv::FILLED);
    const Color color = Color::all(p.rng.uniform(0, 255));
    small_text(p, random_word(p.rng, 2, 3), x, y, 9, color);
  }
  for (const double y : {14.0, style.height - 14}) {  // bolts
    if (!p.with_probability(0.5)) continue;
    for (const double x : {66.0, style.width - 66}) {
      if (!p.with_probability(0.8)) continue;
      const double tone = p.rng.uniform(20, 240);
      cv::circle(p.image, p.at(x, y), std::max(1, p.px(6)), Color::all(tone), cv::FILLED,
                 cv::LINE_AA);
      cv::circle(p.image, p.at(x, y), std::max(1, p.px(3)), Color::all(255 - tone), 1, cv::LINE_AA);
    }
  }
}

}  // namespace tarsier::synth
