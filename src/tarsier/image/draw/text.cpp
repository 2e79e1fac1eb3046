// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/text.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tarsier::image::draw {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kCapitalHeight = 21;  // px at scale 1
constexpr double kReadableHeight = 8;
constexpr double kMinHeight = 4;  // smaller letters are illegible

// One byte per character, so that a two-byte letter does not become two question marks.
std::string to_ascii(std::string_view text) {
  std::string ascii;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0U) == 0x80U) continue;
    ascii += byte >= 32 && byte < 127 ? c : (byte == '\t' ? ' ' : '?');
  }
  return ascii;
}

std::vector<std::string> lines_of(std::string_view text) {
  std::vector<std::string> lines;
  while (true) {
    const std::size_t end = text.find('\n');
    lines.push_back(to_ascii(text.substr(0, end)));
    if (end == std::string_view::npos) return lines;
    text.remove_prefix(end + 1);
  }
}

struct Layout {
  double scale = 1;
  int thickness = 1;
  int capital = 0;  // px
  int descent = 0;  // px below the baseline
  int margin = 0;   // px around the text
  int step = 0;     // px from baseline to baseline
};

Layout layout_for(double height, bool bold) {
  Layout layout;
  layout.scale = height / kCapitalHeight;
  layout.thickness = std::max(1, static_cast<int>(std::lround(height * (bold ? 0.15 : 0.1))));
  layout.capital = static_cast<int>(std::lround(height));
  layout.descent = static_cast<int>(std::ceil(height * 0.4));
  layout.margin = static_cast<int>(std::ceil(height * 0.38)) + layout.thickness / 2;
  layout.step = static_cast<int>(std::lround(height * 1.75));
  return layout;
}

int width_of(const std::string& line, const Layout& layout) {
  if (line.empty()) return 0;
  int base = 0;
  return cv::getTextSize(line, kFont, layout.scale, layout.thickness, &base).width;
}

cv::Size box_of(const std::vector<std::string>& lines, const Layout& layout) {
  int width = 0;
  for (const std::string& line : lines) width = std::max(width, width_of(line, layout));
  const int height =
      layout.capital + layout.descent + layout.step * (static_cast<int>(lines.size()) - 1);
  return {width + 2 * layout.margin, height + 2 * layout.margin};
}

// The longest beginning of `text` that is at most `width` wide, with ".." if it was cut.
std::string cut_to(const std::string& text, int width, double height) {
  if (text_size(text, height).width <= width) return text;
  std::string cut = text;
  while (!cut.empty() && text_size(cut + "..", height).width > width) cut.pop_back();
  return cut.empty() ? cut : cut + "..";
}

void check_height(double height) {
  TARSIER_REQUIRE(height >= kMinHeight && height <= 400, "text height {} px outside {}..400",
                  height, kMinHeight);
}

}  // namespace

double fitting_text_height(cv::Size image) {
  return std::clamp(std::min(image.width, image.height) / 30.0, kReadableHeight, 60.0);
}

cv::Size text_size(std::string_view text, double height_px, bool bold) {
  check_height(height_px);
  return box_of(lines_of(text), layout_for(height_px, bold));
}

cv::Rect put_text(cv::Mat& image, std::string_view text, cv::Point at, const TextStyle& style,
                  Anchor anchor) {
  require_canvas(image);
  const double height = style.height_px > 0 ? style.height_px : fitting_text_height(image.size());
  check_height(height);
  const std::vector<std::string> lines = lines_of(text);
  const Layout layout = layout_for(height, style.bold);
  const cv::Size size = box_of(lines, layout);
  const int column = static_cast<int>(anchor) % 3;
  const int row = static_cast<int>(anchor) / 3;
  const cv::Rect box(at.x - size.width * column / 2, at.y - size.height * row / 2, size.width,
                     size.height);

  if (style.backing == Backing::kBox) {
    fill_rounded(image, box, std::min(layout.margin, layout.capital / 2), style.backing_color,
                 style.box_opacity);
  }
  const int rim = std::max(2, static_cast<int>(std::lround(height * 0.12)) * 2);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (lines[i].empty()) continue;
    const int slack = size.width - 2 * layout.margin - width_of(lines[i], layout);
    const cv::Point base(
        box.x + layout.margin + slack * column / 2,
        box.y + layout.margin + layout.capital + layout.step * static_cast<int>(i));
    if (style.backing == Backing::kOutline) {
      cv::putText(image, lines[i], base, kFont, layout.scale, style.backing_color,
                  layout.thickness + rim, cv::LINE_AA);
    }
    cv::putText(image, lines[i], base, kFont, layout.scale, style.color, layout.thickness,
                cv::LINE_AA);
  }
  return box;
}

cv::Rect status_bar(cv::Mat& image, std::string_view left, std::string_view right) {
  constexpr std::string_view kGap = "   ";
  require_canvas(image);
  const std::string first = to_ascii(left);
  std::string second = to_ascii(right);
  double height = fitting_text_height(image.size()) * 0.8;
  height = std::max(height, kReadableHeight);
  const auto total = [&] {
    return text_size(first, height).width + (second.empty() ? 0 : text_size(second, height).width);
  };
  while (height > kReadableHeight && total() > image.cols)
    height = std::max(kReadableHeight, height * 0.9);
  while (!second.empty() && total() > image.cols &&
         text_size(second, height).width > image.cols / 2) {
    const std::size_t gap = second.find(kGap);
    second = gap == std::string::npos ? "" : second.substr(gap + kGap.size());
  }
  const int bar_height = text_size("X", height).height;
  const cv::Rect bar(0, image.rows - bar_height, image.cols, bar_height);
  fill_rounded(image, bar, 0, {0, 0, 0}, 0.6);
  TextStyle style;
  style.height_px = height;
  style.backing = Backing::kNone;
  int room = image.cols;
  if (!second.empty()) {
    put_text(image, second, {image.cols, bar.y}, style, Anchor::kTopRight);
    room -= text_size(second, height).width;
  }
  put_text(image, cut_to(first, room, height), {0, bar.y}, style);
  return bar;
}

void help_overlay(cv::Mat& image, std::string_view title, std::span<const HelpLine> lines) {
  require_canvas(image);
  std::string keys;
  std::string texts;
  for (const HelpLine& line : lines) {
    keys += (keys.empty() ? "" : "\n") + line.key;
    texts += (texts.empty() ? "" : "\n") + line.text;
  }
  double height = fitting_text_height(image.size());
  cv::Size key_size;
  cv::Size text_box;
  cv::Size title_box;
  cv::Size panel;
  while (true) {
    key_size = text_size(keys, height, true);
    text_box = text_size(texts, height);
    title_box = text_size(title, height * 1.2, true);
    panel = {std::max(key_size.width + text_box.width, title_box.width),
             title_box.height + text_box.height};
    if ((panel.width <= image.cols && panel.height <= image.rows) || height <= kMinHeight + 0.01)
      break;
    height = std::max(kMinHeight, height * 0.93);
  }
  const int pad = static_cast<int>(height);
  const cv::Rect inner((image.cols - panel.width) / 2, (image.rows - panel.height) / 2, panel.width,
                       panel.height);
  fill_rounded(image, {inner.x - pad, inner.y - pad, inner.width + 2 * pad, inner.height + 2 * pad},
               pad, {0, 0, 0}, 0.75);
  TextStyle style;
  style.backing = Backing::kNone;
  style.bold = true;
  style.height_px = height * 1.2;
  put_text(image, title, {inner.x, inner.y}, style);
  style.height_px = height;
  style.color = {80, 210, 255};
  put_text(image, keys, {inner.x, inner.y + title_box.height}, style);
  style.bold = false;
  style.color = {255, 255, 255};
  put_text(image, texts, {inner.x + key_size.width, inner.y + title_box.height}, style);
}

}  // namespace tarsier::image::draw
