// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <span>
#include <string>
#include <string_view>

namespace tarsier::image::draw {

// Text on images. Images are CV_8UC3 (BGR) or CV_8UC1 (then the first number of a colour counts),
// not empty; others throw std::invalid_argument. The font has ASCII only: any other character
// becomes one '?'. Lines are separated by '\n'. What lies outside the image is cut off.

// Which point of the text's box is placed.
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

// What makes text readable on any image.
enum class Backing { kNone, kOutline, kBox };

struct TextStyle {
  double height_px = 0;  // of a capital letter, [4, 400]; 0: fitting_text_height() of the image
  cv::Scalar color{255, 255, 255};  // BGR, each 0..255
  Backing backing = Backing::kOutline;
  cv::Scalar backing_color{0, 0, 0};
  double box_opacity = 0.6;  // of Backing::kBox, 0..1
  bool bold = false;
};

// Height of a capital letter, px, that reads well on an image of this size: a 30th of the shorter
// side, at least 8, at most 60.
[[nodiscard]] double fitting_text_height(cv::Size image);

// Width and height in px of the box that put_text fills (lines and their spacing, and a small
// margin around).
[[nodiscard]] cv::Size text_size(std::string_view text, double height_px, bool bold = false);

// Puts `text` so that `anchor` of its box is at `at` (px). Returns the box, also where it was cut
// off.
cv::Rect put_text(cv::Mat& image, std::string_view text, cv::Point at, const TextStyle& style = {},
                  Anchor anchor = Anchor::kTopLeft);

// A dark bar along the lower edge, `left` and `right` in it, with letters that fit. Text that is
// too wide is made smaller; then the first parts of `right` are left out, which three spaces
// separate, until it takes half of the bar at most, and the end of `left`. Returns the bar.
cv::Rect status_bar(cv::Mat& image, std::string_view left, std::string_view right = "");

struct HelpLine {
  std::string key;   // "s", "Esc"
  std::string text;  // "pencil sketch"
};

// A dark panel in the middle of the image: the title, then one line for each key. Letters shrink
// until it fits.
void help_overlay(cv::Mat& image, std::string_view title, std::span<const HelpLine> lines);

}  // namespace tarsier::image::draw
