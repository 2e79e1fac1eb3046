// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/tile.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/text.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::image::draw {
namespace {

constexpr double kMaxEnlargement = 4;

// Scales from the minimum to the maximum finite value. Infinities go to the ends, NaN to the lower
// one.
template <typename T>
cv::Mat contrast_stretched(const cv::Mat& image) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  const int width = image.cols * image.channels();
  for (int y = 0; y < image.rows; ++y) {
    const T* row = image.ptr<T>(y);
    for (int x = 0; x < width; ++x) {
      const auto value = static_cast<double>(row[x]);
      if (!std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  cv::Mat bytes(image.size(), CV_8UC(image.channels()));
  for (int y = 0; y < image.rows; ++y) {
    const T* from = image.ptr<T>(y);
    auto* to = bytes.ptr<std::uint8_t>(y);
    for (int x = 0; x < width; ++x) {
      const auto value = static_cast<double>(from[x]);
      // Computed from halves, because the difference of two doubles may be infinite.
      const double share = high > low ? (value / 2 - low / 2) / (high / 2 - low / 2) : 0;
      to[x] = share >= 1  ? 255
              : share > 0 ? static_cast<std::uint8_t>(std::lround(share * 255))
                          : 0;
    }
  }
  return bytes;
}

// Converts any image to CV_8UC3.
cv::Mat to_bgr(const cv::Mat& image) {
  const int depth = image.depth();
  const int channels = image.channels();
  TARSIER_REQUIRE(
      image.dims == 2 && (depth == CV_8U || depth == CV_16U || depth == CV_32F || depth == CV_64F),
      "cannot show a matrix of depth {}", depth);
  TARSIER_REQUIRE(channels == 1 || channels == 3 || channels == 4, "cannot show {} channels",
                  channels);
  cv::Mat bytes = image;
  if (depth == CV_16U) {
    image.convertTo(bytes, CV_8U, 1.0 / 257);
  } else if (depth != CV_8U) {
    bytes = depth == CV_32F ? contrast_stretched<float>(image) : contrast_stretched<double>(image);
  }
  cv::Mat color;
  if (channels == 1) {
    cv::cvtColor(bytes, color, cv::COLOR_GRAY2BGR);
  } else if (channels == 4) {
    cv::cvtColor(bytes, color, cv::COLOR_BGRA2BGR);
  } else {
    color = bytes;
  }
  return color;
}

cv::Size fitted(cv::Size image, cv::Size cell) {
  const double scale = std::min({static_cast<double>(cell.width) / image.width,
                                 static_cast<double>(cell.height) / image.height, kMaxEnlargement});
  return {std::clamp(static_cast<int>(std::lround(image.width * scale)), 1, cell.width),
          std::clamp(static_cast<int>(std::lround(image.height * scale)), 1, cell.height)};
}

void draw_fitted(const cv::Mat& image, const cv::Mat& cell) {
  const cv::Mat color = to_bgr(image);
  const cv::Size size = fitted(color.size(), cell.size());
  cv::Mat scaled;
  // Averaging keeps thin lines when shrinking; enlarged pixels stay visible as pixels.
  cv::resize(color, scaled, size, 0, 0,
             size.width < color.cols ? cv::INTER_AREA : cv::INTER_NEAREST);
  scaled.copyTo(cell(cv::Rect((cell.cols - size.width) / 2, (cell.rows - size.height) / 2,
                              size.width, size.height)));
}

}  // namespace

cv::Mat letterbox(const cv::Mat& image, cv::Size size, const cv::Scalar& background) {
  TARSIER_REQUIRE(size.width >= 1 && size.height >= 1, "size {}x{} px", size.width, size.height);
  TARSIER_REQUIRE(!image.empty(), "the image is empty");
  cv::Mat result(size, CV_8UC3, background);
  draw_fitted(image, result);
  return result;
}

cv::Mat tile(std::span<const cv::Mat> images, std::span<const std::string> names, cv::Size size) {
  TARSIER_REQUIRE(images.size() == names.size(), "{} images, {} names", images.size(),
                  names.size());
  TARSIER_REQUIRE(size.width >= 16 && size.height >= 16, "size {}x{} px", size.width, size.height);
  cv::Mat result(size, CV_8UC3, cv::Scalar(32, 32, 32));
  const int count = static_cast<int>(images.size());
  if (count == 0) return result;

  constexpr int kGap = 2;
  int best_columns = 1;
  double best_area = -1;
  for (int columns = 1; columns <= count; ++columns) {
    const int rows = (count + columns - 1) / columns;
    const cv::Size cell(size.width / columns - kGap, size.height / rows - kGap);
    if (cell.width < 1 || cell.height < 1) continue;
    double area = 0;
    for (const cv::Mat& image : images) {
      if (!image.empty()) area += fitted(image.size(), cell).area();
    }
    if (area > best_area) {
      best_area = area;
      best_columns = columns;
    }
  }
  const int rows = (count + best_columns - 1) / best_columns;
  for (int i = 0; i < count; ++i) {
    // The remainder is distributed over the cells, so that the grid reaches the right and lower
    // edge.
    const int column = i % best_columns;
    const int row = i / best_columns;
    const int x = size.width * column / best_columns;
    const int y = size.height * row / rows;
    const cv::Rect cell(x, y, std::max(1, size.width * (column + 1) / best_columns - x - kGap),
                        std::max(1, size.height * (row + 1) / rows - y - kGap));
    cv::Mat part = result(cell & cv::Rect({0, 0}, size));
    if (part.empty()) continue;
    const auto index = static_cast<std::size_t>(i);
    if (!images[index].empty()) draw_fitted(images[index], part);
    TextStyle style;
    style.height_px = std::clamp(part.rows / 22.0, 7.0, 24.0);
    style.backing = Backing::kBox;
    if (!names[index].empty()) put_text(part, names[index], {0, 0}, style);
  }
  return result;
}

}  // namespace tarsier::image::draw
