// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <span>
#include <string>
#include <string_view>

namespace tarsier::image::draw {

// Draws text on images: CV_8UC3 (BGR) or CV_8UC1 (then the first number of a colour is used), not
// empty; otherwise std::invalid_argument is thrown. The font has only ASCII: any other character
// becomes one '?'. Lines are separated by '\n'. Text is clipped to the image.

// The point of the text's box that is positioned.
enum class Anchor {
  kTopLeft,
  kTop,
  kTopRight,
  kLeft,
  kCenter,
  kRight,
  kBottomLeft,
  kBottom,
  kBottomRight,
};

// Background of the text, for readability on any image.
enum class Backing { kNone, kOutline, kBox };

struct TextStyle {
  double height_px = 0;  // of a capital letter, [4, 400]; 0: fitting_text_height() of the image
  cv::Scalar color{255, 255, 255};  // BGR, each 0..255
  Backing backing = Backing::kOutline;
  cv::Scalar backing_color{0, 0, 0};
  double box_opacity = 0.6;  // of Backing::kBox, 0..1
  bool bold = false;
};

// Height of a capital letter, px, that is readable on an image of this size: a 30th of the shorter
// side, at least 8, at most 60.
[[nodiscard]] double fitting_text_height(cv::Size image);

// Width and height, px, of the box that put_text fills (lines with their spacing, and a small
// margin).
[[nodiscard]] cv::Size text_size(std::string_view text, double height_px, bool bold = false);

// Draws `text` with the `anchor` of its box at `at` (px). Returns the box, including clipped parts.
cv::Rect put_text(cv::Mat& image, std::string_view text, cv::Point at, const TextStyle& style = {},
                  Anchor anchor = Anchor::kTopLeft);

// A dark bar along the lower edge with `left` and `right`. Text that is too wide is drawn smaller.
// If that is not enough, the first parts of `right` (separated by three spaces) are dropped until
// it takes at most half of the bar, and the end of `left` is cut. Returns the bar.
cv::Rect status_bar(cv::Mat& image, std::string_view left, std::string_view right = "");

struct HelpLine {
  std::string key;   // "s", "Esc"
  std::string text;  // "pencil sketch"
};

// A dark panel in the centre of the image: the title, then one line per key. The letters are scaled
// to fit.
void help_overlay(cv::Mat& image, std::string_view title, std::span<const HelpLine> lines);

}  // namespace tarsier::image::draw
