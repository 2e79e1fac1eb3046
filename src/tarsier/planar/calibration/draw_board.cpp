// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/draw_board.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/planar/calibration/lens_fit.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::planar::calibration {
namespace {

constexpr int kShift = 4;  // fractional bits of a pixel

cv::Point fine(const cv::Point2d& p) {
  return {cvRound(p.x * (1 << kShift)), cvRound(p.y * (1 << kShift))};
}

// Rainbow colours, 0..1, bright on any background.
cv::Scalar rainbow(double at) {
  const auto channel = [&](double middle) {
    return 255 * std::clamp(1.5 - std::abs(at * 4 - middle), 0.0, 1.0);
  };
  return {channel(1) + 40, channel(2) + 40, channel(3) + 40};
}

double line_width(const cv::Mat& image) {
  return std::max(1.0, std::max(image.cols, image.rows) / 640.0);
}

}  // namespace

void draw_view(cv::Mat& image, const BoardView& view, const BoardSpec& spec) {
  image::draw::require_canvas(image);
  if (view.empty()) return;
  const double width = line_width(image);
  const int rows = spec.grid().height;
  const auto color = [&](int point) {
    return rainbow(rows > 1 ? static_cast<double>(point / spec.grid().width) / (rows - 1) : 0);
  };
  for (std::size_t i = 1; i < view.points.size(); ++i) {
    cv::line(image, fine(view.pixels[i - 1]), fine(view.pixels[i]), color(view.points[i]),
             std::max(1, cvRound(width)), cv::LINE_AA, kShift);
  }
  for (std::size_t i = 0; i < view.points.size(); ++i)
    image::draw::point(image, view.pixels[i], color(view.points[i]), 2.5 * width);
  cv::circle(image, fine(view.pixels[0]), cvRound(7 * width * (1 << kShift)), color(view.points[0]),
             std::max(1, cvRound(1.5 * width)), cv::LINE_AA, kShift);
}

void draw_errors(cv::Mat& image, const BoardView& view, const BoardSpec& spec,
                 const geometry::Camera& camera, const geometry::Rigid3& camera_from_board,
                 double scale) {
  image::draw::require_canvas(image);
  const int width = std::max(1, cvRound(line_width(image)));
  for (std::size_t i = 0; i < view.points.size(); ++i) {
    const auto at = board_pixel(camera, camera_from_board, spec.point(view.points[i]));
    if (!at) continue;
    const cv::Point2d error = cv::Point2d(view.pixels[i]) - *at;
    cv::circle(image, fine(*at), 2 << kShift, {255, 200, 0}, width, cv::LINE_AA, kShift);
    cv::line(image, fine(*at), fine(*at + scale * error), {0, 0, 255}, width, cv::LINE_AA, kShift);
  }
}

void draw_coverage(cv::Mat& image, const Coverage& coverage, double opacity) {
  image::draw::require_canvas(image);
  TARSIER_REQUIRE(image.channels() == 3, "{} channels", image.channels());
  for (int row = 0; row < kCoverageRows; ++row) {
    for (int column = 0; column < kCoverageColumns; ++column) {
      const cv::Rect box(
          cv::Point(column * image.cols / kCoverageColumns, row * image.rows / kCoverageRows),
          cv::Point((column + 1) * image.cols / kCoverageColumns,
                    (row + 1) * image.rows / kCoverageRows));
      if (box.empty()) continue;
      const int views = coverage.cells[static_cast<std::size_t>(row * kCoverageColumns + column)];
      const double weight = views == 0 ? 0.5 * opacity : opacity * std::min(1.0, 0.4 + 0.2 * views);
      const cv::Scalar color = views == 0 ? cv::Scalar(40, 40, 200) : cv::Scalar(60, 200, 60);
      cv::Mat part = image(box);
      const cv::Mat tint(part.size(), CV_8UC3, color);
      cv::addWeighted(part, 1 - weight, tint, weight, 0, part);
      cv::rectangle(image, box, {90, 90, 90}, 1);
    }
  }
}

cv::Mat coverage_image(const std::vector<BoardView>& views, const Coverage& coverage, int width) {
  TARSIER_REQUIRE(coverage.size.width > 0 && coverage.size.height > 0, "{}x{} px",
                  coverage.size.width, coverage.size.height);
  TARSIER_REQUIRE(width >= 64 && width <= 4000, "{} px", width);
  const double scale = static_cast<double>(width) / coverage.size.width;
  const int height = std::clamp(cvRound(coverage.size.height * scale), 16, 8000);
  cv::Mat image(height, width, CV_8UC3, cv::Scalar(250, 250, 250));
  draw_coverage(image, coverage, 0.5);
  int number = 0;
  for (const BoardView& view : views) {
    if (view.empty()) continue;
    const cv::Scalar color = rainbow(std::fmod(0.381966 * number++, 1.0)) * 0.8;
    for (const cv::Point2f& p : view.pixels) {
      const cv::Point2d at((p.x + 0.5) * scale - 0.5, (p.y + 0.5) * scale - 0.5);
      cv::circle(image, fine(at), cvRound(2.2 * width / 640 * (1 << kShift)), color, cv::FILLED,
                 cv::LINE_AA, kShift);
    }
  }
  image::draw::status_bar(image, fmt::format("{} views", coverage.views),
                          fmt::format("{:.0f} % covered", 100 * coverage.share()));
  return image;
}

}  // namespace tarsier::planar::calibration
