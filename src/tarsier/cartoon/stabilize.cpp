// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/stabilize.h"

#include "tarsier/cartoon/rows.h"

#include <opencv2/imgproc.hpp>

#include <cstdlib>

namespace tarsier::cartoon {

void Stabilizer::smooth(Plane& gray, const SteadyOptions& options) {
  const auto count = static_cast<size_t>(gray.width()) * static_cast<size_t>(gray.height());
  if (gray.width() != width_ || gray.height() != height_) {
    width_ = gray.width();
    height_ = gray.height();
    level_.assign(count, 0);
    moved_.assign(count, 0);
    line_.assign(count, 0);
    change_.assign(count, 0);
    fresh_ = true;
  }
  const auto width = static_cast<size_t>(width_);
  for_row_bands(height_, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      const std::uint8_t* now = gray.row(y);
      const std::uint16_t* level = level_.data() + static_cast<size_t>(y) * width;
      std::uint8_t* change = change_.data() + static_cast<size_t>(y) * width;
      for (size_t x = 0; x < width; ++x) {
        change[x] = static_cast<std::uint8_t>(std::abs(now[x] - ((level[x] + 128) >> 8)));
      }
    }
  });
  cv::Mat change(height_, width_, CV_8UC1, change_.data());
  cv::Mat moved(height_, width_, CV_8UC1, moved_.data());
  cv::blur(change, moved, cv::Size(5, 5));
  const int change_limit = options.motion;
  const int mean_limit = (options.motion + 2) / 3;
  for_row_bands(height_, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      std::uint8_t* now = gray.row(y);
      std::uint16_t* level = level_.data() + static_cast<size_t>(y) * width;
      const std::uint8_t* pixel_change = change_.data() + static_cast<size_t>(y) * width;
      std::uint8_t* mean = moved_.data() + static_cast<size_t>(y) * width;
      for (size_t x = 0; x < width; ++x) {
        const bool moves = fresh_ || pixel_change[x] > change_limit || mean[x] > mean_limit;
        const int target = now[x] << 8;
        const int next = moves ? target : level[x] + (target - level[x]) / options.memory;
        level[x] = static_cast<std::uint16_t>(next);
        now[x] = static_cast<std::uint8_t>(std::min((next + 128) >> 8, 255));
        mean[x] = moves ? 255 : 0;
      }
    }
  });
}

void Stabilizer::threshold(const Plane& response, int threshold, const SteadyOptions& options,
                           Plane& mask) {
  const auto width = static_cast<size_t>(width_);
  const auto half_band = static_cast<int>(threshold * options.hysteresis + 0.5);
  for_row_bands(height_, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      const std::uint8_t* r = response.row(y);
      const std::uint8_t* moved = moved_.data() + static_cast<size_t>(y) * width;
      std::uint8_t* line = line_.data() + static_cast<size_t>(y) * width;
      std::uint8_t* out = mask.row(y);
      for (size_t x = 0; x < width; ++x) {
        const int lean = moved[x] != 0 ? 0 : line[x] != 0 ? -half_band : half_band;
        const bool is_line = r[x] > threshold + lean;
        line[x] = is_line ? 255 : 0;
        out[x] = is_line ? 0 : 255;
      }
    }
  });
  fresh_ = false;
}

}  // namespace tarsier::cartoon
