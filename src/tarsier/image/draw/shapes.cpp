// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/shapes.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::image::draw {
namespace {

constexpr int kShift = 4;  // OpenCV's fixed-point coordinates: 1/16 px
constexpr double kMaxCoordinate = 1e6;

// Limits far points: they are clipped anyway, and the fixed-point coordinates cannot overflow.
cv::Point fixed(cv::Point2d at) {
  const auto convert = [](double v) {
    return static_cast<int>(
        std::lround(std::clamp(v, -kMaxCoordinate, kMaxCoordinate) * (1 << kShift)));
  };
  return {convert(at.x), convert(at.y)};
}

int fixed(double v) {
  return static_cast<int>(std::lround(std::clamp(v, 0.0, kMaxCoordinate) * (1 << kShift)));
}

}  // namespace

void require_canvas(const cv::Mat& image) {
  TARSIER_REQUIRE(
      image.dims == 2 && !image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
      "cannot draw on {}x{}, type {}: only 8-bit grey or BGR", image.cols, image.rows,
      image.type());
}

void point(cv::Mat& image, cv::Point2d at, const cv::Scalar& color, double radius) {
  require_canvas(image);
  TARSIER_REQUIRE(radius > 0, "radius {} px", radius);
  if (!std::isfinite(at.x) || !std::isfinite(at.y)) return;
  const double rim = std::max(1.0, radius * 0.35);
  cv::circle(image, fixed(at), fixed(radius + rim), cv::Scalar(0, 0, 0), cv::FILLED, cv::LINE_AA,
             kShift);
  cv::circle(image, fixed(at), fixed(radius), color, cv::FILLED, cv::LINE_AA, kShift);
}

void cross(cv::Mat& image, cv::Point2d at, const cv::Scalar& color, double arm) {
  require_canvas(image);
  TARSIER_REQUIRE(arm > 0, "arm {} px", arm);
  if (!std::isfinite(at.x) || !std::isfinite(at.y)) return;
  const int thickness = std::max(1, static_cast<int>(std::lround(arm / 5)));
  for (const bool rim : {true, false}) {
    const double reach = rim ? arm + 1 : arm;
    const cv::Scalar paint = rim ? cv::Scalar(0, 0, 0) : color;
    const int width = rim ? thickness + 2 : thickness;
    cv::line(image, fixed(at - cv::Point2d(reach, 0)), fixed(at + cv::Point2d(reach, 0)), paint,
             width, cv::LINE_AA, kShift);
    cv::line(image, fixed(at - cv::Point2d(0, reach)), fixed(at + cv::Point2d(0, reach)), paint,
             width, cv::LINE_AA, kShift);
  }
}

void fill_rounded(cv::Mat& image, const cv::Rect& box, int radius, const cv::Scalar& color,
                  double opacity) {
  require_canvas(image);
  TARSIER_REQUIRE(radius >= 0, "radius {} px", radius);
  TARSIER_REQUIRE(opacity >= 0 && opacity <= 1, "opacity {} outside 0..1", opacity);
  const cv::Rect seen = box & cv::Rect({0, 0}, image.size());
  if (seen.empty() || opacity == 0) return;
  // The corners are measured at pixel centres; blending over one pixel smooths their edge.
  const double r = std::min<double>(radius, std::min(box.width, box.height) / 2.0);
  const int channels = image.channels();
  const double left = box.x + r - 0.5;
  const double right = box.x + box.width - r - 0.5;
  const double top = box.y + r - 0.5;
  const double bottom = box.y + box.height - r - 0.5;
  for (int y = seen.y; y < seen.y + seen.height; ++y) {
    std::uint8_t* row = image.ptr<std::uint8_t>(y) + static_cast<std::ptrdiff_t>(seen.x) * channels;
    const double dy = std::max({top - y, y - bottom, 0.0});
    for (int x = seen.x; x < seen.x + seen.width; ++x, row += channels) {
      const double dx = std::max({left - x, x - right, 0.0});
      double share = opacity;
      if (dx > 0 && dy > 0) share *= std::clamp(r - std::hypot(dx, dy) + 0.5, 0.0, 1.0);
      for (int c = 0; c < channels; ++c) {
        row[c] = cv::saturate_cast<std::uint8_t>(row[c] + (color[c] - row[c]) * share);
      }
    }
  }
}

void button(cv::Mat& image, const cv::Rect& box, std::string_view label, bool pressed) {
  require_canvas(image);
  TARSIER_REQUIRE(box.width > 0 && box.height > 0, "button of {}x{} px", box.width, box.height);
  const int radius = std::min(box.width, box.height) / 4;
  fill_rounded(image, box, radius, pressed ? cv::Scalar(255, 255, 255) : cv::Scalar(220, 220, 220),
               0.9);
  const cv::Rect inner(box.x + 1, box.y + 1, box.width - 2, box.height - 2);
  if (!inner.empty()) {
    fill_rounded(image, inner, std::max(0, radius - 1),
                 pressed ? cv::Scalar(190, 130, 30) : cv::Scalar(60, 60, 60), 0.9);
  }
  double height = std::clamp(box.height * 0.4, 4.0, 60.0);
  while (height > 4 && text_size(label, height).width > box.width)
    height = std::max(4.0, height * 0.93);
  TextStyle style;
  style.height_px = height;
  style.backing = Backing::kNone;
  put_text(image, label, {box.x + box.width / 2, box.y + box.height / 2}, style, Anchor::kCenter);
}

void bar(cv::Mat& image, const cv::Rect& box, double fraction, const cv::Scalar& color,
         std::string_view label) {
  require_canvas(image);
  TARSIER_REQUIRE(box.width > 0 && box.height > 0, "bar of {}x{} px", box.width, box.height);
  TARSIER_REQUIRE(fraction >= 0 && fraction <= 1, "fraction {} outside 0..1", fraction);
  const int radius = box.height / 3;
  fill_rounded(image, box, radius, {30, 30, 30}, 0.8);
  const int filled = static_cast<int>(std::lround(box.width * fraction));
  if (filled > 0) fill_rounded(image, {box.x, box.y, filled, box.height}, radius, color);
  if (!label.empty()) {
    TextStyle style;
    style.height_px = std::clamp(box.height * 0.8, 4.0, 60.0);
    put_text(image, label, {box.x + box.width, box.y + box.height / 2}, style, Anchor::kLeft);
  }
}

}  // namespace tarsier::image::draw
