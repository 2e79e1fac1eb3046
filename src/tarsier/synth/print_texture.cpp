// SPDX-License-Identifier: MIT
#include "tarsier/synth/print_texture.h"

#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace tarsier::synth {
namespace {

constexpr float kFlat = 2.0F;  // maximum difference of grey levels in a uniform block

// Faster than std::floor, which is a library call for older processors.
int floor_of(float value) {
  const int whole = static_cast<int>(value);
  return static_cast<float>(whole) > value ? whole - 1 : whole;
}

// Floats with alpha, colours premultiplied.
cv::Mat premultiplied(const cv::Mat& image) {
  cv::Mat bgra;
  if (image.channels() == 1)
    cv::cvtColor(image, bgra, cv::COLOR_GRAY2BGRA);
  else if (image.channels() == 3)
    cv::cvtColor(image, bgra, cv::COLOR_BGR2BGRA);
  else
    bgra = image;
  cv::Mat pixels;
  bgra.convertTo(pixels, CV_32F);
  for (int y = 0; y < pixels.rows; ++y) {
    auto* row = pixels.ptr<cv::Vec4f>(y);
    for (int x = 0; x < pixels.cols; ++x) {
      const float alpha = row[x][3] / 255.0F;
      row[x] = {row[x][0] * alpha, row[x][1] * alpha, row[x][2] * alpha, alpha};
    }
  }
  return pixels;
}

// The extreme of each 2 x 2 block; rounds odd sizes up.
cv::Mat halved(const cv::Mat& from, bool largest) {
  cv::Mat to((from.rows + 1) / 2, (from.cols + 1) / 2, from.type());
  for (int y = 0; y < to.rows; ++y) {
    for (int x = 0; x < to.cols; ++x) {
      auto value = from.at<cv::Vec4f>(2 * y, 2 * x);
      for (int dy = 0; dy < 2; ++dy) {
        for (int dx = 0; dx < 2; ++dx) {
          const auto& other = from.at<cv::Vec4f>(std::min(2 * y + dy, from.rows - 1),
                                                 std::min(2 * x + dx, from.cols - 1));
          for (int c = 0; c < 4; ++c)
            value[c] = largest ? std::max(value[c], other[c]) : std::min(value[c], other[c]);
        }
      }
      to.at<cv::Vec4f>(y, x) = value;
    }
  }
  return to;
}

cv::Mat flat_blocks(const cv::Mat& low, const cv::Mat& high) {
  cv::Mat lowest;
  cv::Mat highest;
  cv::erode(low, lowest, cv::Mat::ones(3, 3, CV_8U), {-1, -1}, 1, cv::BORDER_REPLICATE);
  cv::dilate(high, highest, cv::Mat::ones(3, 3, CV_8U), {-1, -1}, 1, cv::BORDER_REPLICATE);
  cv::Mat flat(low.size(), CV_8UC1);
  for (int y = 0; y < flat.rows; ++y) {
    for (int x = 0; x < flat.cols; ++x) {
      const cv::Vec4f range = highest.at<cv::Vec4f>(y, x) - lowest.at<cv::Vec4f>(y, x);
      flat.at<uchar>(y, x) =
          range[0] <= kFlat && range[1] <= kFlat && range[2] <= kFlat && range[3] <= kFlat / 255
              ? 1
              : 0;
    }
  }
  return flat;
}

}  // namespace

PrintTexture::PrintTexture(const cv::Mat& image, bool mirrored)
    : width_(image.cols), height_(image.rows), mirrored_(mirrored) {
  TARSIER_REQUIRE(!image.empty() && image.depth() == CV_8U && image.channels() != 2, "type {}",
                  image.type());
  TARSIER_REQUIRE(image.cols <= 8192 && image.rows <= 8192, "{}x{} px", image.cols, image.rows);
  levels_.push_back({premultiplied(image), 1, 1});
  while (levels_.back().pixels.cols > 1 || levels_.back().pixels.rows > 1) {
    const cv::Mat& last = levels_.back().pixels;
    Level next;
    cv::resize(last, next.pixels, {(last.cols + 1) / 2, (last.rows + 1) / 2}, 0, 0, cv::INTER_AREA);
    next.scale_x = static_cast<float>(next.pixels.cols / width_);
    next.scale_y = static_cast<float>(next.pixels.rows / height_);
    levels_.push_back(std::move(next));
  }
  // A mirrored texture is the ground: one sample per pixel, uniform or not.
  if (!mirrored_) find_flat_blocks();
}

void PrintTexture::find_flat_blocks() {
  cv::Mat low = levels_[0].pixels;
  cv::Mat high = low;
  for (int k = 0; k < 7; ++k) {
    flat_.push_back(flat_blocks(low, high));
    if (low.cols == 1 && low.rows == 1) break;
    low = halved(low, false);
    high = halved(high, true);
  }
}

int PrintTexture::wrapped(int i, int size) const {
  if (i >= 0 && i < size) return i;
  if (!mirrored_) return std::clamp(i, 0, size - 1);
  const int period = 2 * size;
  int m = i % period;
  if (m < 0) m += period;
  return m < size ? m : period - 1 - m;
}

Pixel4 PrintTexture::sample(int level, float u, float v) const {
  const Level& at = levels_[static_cast<std::size_t>(level)];
  const int columns = at.pixels.cols;
  const int rows = at.pixels.rows;
  const float x = u * at.scale_x - 0.5F;
  const float y = v * at.scale_y - 0.5F;
  const int left = floor_of(x);
  const int top = floor_of(y);
  const float fx = x - static_cast<float>(left);
  const float fy = y - static_cast<float>(top);
  int x0 = left;
  int x1 = left + 1;
  int y0 = top;
  int y1 = top + 1;
  if (x0 < 0 || y0 < 0 || x1 >= columns || y1 >= rows) {
    x0 = wrapped(x0, columns);
    x1 = wrapped(x1, columns);
    y0 = wrapped(y0, rows);
    y1 = wrapped(y1, rows);
  }
  const auto* upper = at.pixels.ptr<float>(y0);
  const auto* lower = at.pixels.ptr<float>(y1);
  const auto load = [](const float* row, int i) {
    Pixel4 pixel;
    std::memcpy(&pixel, row + 4 * static_cast<std::ptrdiff_t>(i), sizeof pixel);
    return pixel;
  };
  const Pixel4 a = load(upper, x0);
  const Pixel4 b = load(lower, x0);
  const Pixel4 above = a + fx * (load(upper, x1) - a);
  const Pixel4 below = b + fx * (load(lower, x1) - b);
  return above + fy * (below - above);
}

bool PrintTexture::is_flat(float u, float v, float reach) const {
  const auto least = static_cast<unsigned>(std::ceil(std::max(1.0F, reach)));
  const auto k = static_cast<std::size_t>(std::bit_width(least - 1U));
  if (k >= flat_.size()) return false;
  const int x = static_cast<int>(u) >> k;
  const int y = static_cast<int>(v) >> k;
  const cv::Mat& blocks = flat_[k];
  return u >= 0 && v >= 0 && x < blocks.cols && y < blocks.rows && blocks.at<uchar>(y, x) != 0;
}

}  // namespace tarsier::synth
