// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/channels.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace tarsier::face::appearance {
namespace {

constexpr NameTable<Channels, 4> kChannels{"channels",
                                           {{{Channels::kGrey, "grey"},
                                             {Channels::kColour, "colour"},
                                             {Channels::kGradient, "gradient"},
                                             {Channels::kOriented, "oriented"}}}};

constexpr double kSmoothing = 0.7;    // px of the crop, before derivatives
constexpr double kPooling = 1.6;      // px, of the oriented channels
constexpr double kContrast = 4.0;     // px, radius of their normalisation
constexpr float kMinContrast = 3.0F;  // grey levels per px; weaker gradients fade out

// The part of the image under the crop, at the crop's resolution or a higher one. False if they do
// not overlap.
bool cut(const cv::Mat& image, const shape::Similarity2d& image_from_crop, cv::Size size,
         cv::Mat& reduced, cv::Mat& crop) {
  const double scale = image_from_crop.scale();
  double low_x = 1e12, low_y = 1e12, high_x = -1e12, high_y = -1e12;
  for (const double x : {0.0, size.width - 1.0}) {
    for (const double y : {0.0, size.height - 1.0}) {
      const Eigen::Vector2d at = image_from_crop(Eigen::Vector2d(x, y));
      low_x = std::min(low_x, at.x());
      high_x = std::max(high_x, at.x());
      low_y = std::min(low_y, at.y());
      high_y = std::max(high_y, at.y());
    }
  }
  const double around = 2 * scale + 2;
  const auto bounded = [](double value, int upper) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(upper)));
  };
  const int left = bounded(std::floor(low_x - around), image.cols);
  const int right = bounded(std::ceil(high_x + around) + 1, image.cols);
  const int top = bounded(std::floor(low_y - around), image.rows);
  const int bottom = bounded(std::ceil(high_y + around) + 1, image.rows);
  if (left >= right || top >= bottom) return false;
  const cv::Rect area(left, top, right - left, bottom - top);

  double sx = 1;
  double sy = 1;
  const cv::Mat* source = &reduced;
  const cv::Mat part = image(area);
  if (scale > 1.2) {
    const cv::Size small(std::max(1, static_cast<int>(std::lround(area.width / scale))),
                         std::max(1, static_cast<int>(std::lround(area.height / scale))));
    cv::resize(part, reduced, small, 0, 0, cv::INTER_AREA);
    sx = static_cast<double>(small.width) / area.width;
    sy = static_cast<double>(small.height) / area.height;
  } else {
    source = &part;
  }
  // Pixel centres are kept by the reduction.
  const cv::Matx23d map(sx * image_from_crop.a, -sx * image_from_crop.b,
                        sx * (image_from_crop.tx - area.x + 0.5) - 0.5, sy * image_from_crop.b,
                        sy * image_from_crop.a, sy * (image_from_crop.ty - area.y + 0.5) - 0.5);
  cv::warpAffine(*source, crop, map, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  return true;
}

void mark_inside(cv::Size image, const shape::Similarity2d& image_from_crop, cv::Size size,
                 cv::Mat& inside) {
  const auto is_inside = [&](double x, double y) {
    const Eigen::Vector2d at = image_from_crop(Eigen::Vector2d(x, y));
    return at.x() >= -0.5 && at.y() >= -0.5 && at.x() <= image.width - 0.5 &&
           at.y() <= image.height - 0.5;
  };
  const double right = size.width - 1.0;
  const double bottom = size.height - 1.0;
  if (is_inside(0, 0) && is_inside(right, 0) && is_inside(0, bottom) && is_inside(right, bottom)) {
    inside.release();
    return;
  }
  inside.create(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    auto* row = inside.ptr<std::uint8_t>(y);
    for (int x = 0; x < size.width; ++x) row[x] = is_inside(x, y) ? 255 : 0;
  }
}

// Central differences, one-sided at the border.
struct Gradient {
  float x, y;
};
inline Gradient gradient_at(const cv::Mat& gray, int x, int y) {
  const int l = std::max(x - 1, 0);
  const int r = std::min(x + 1, gray.cols - 1);
  const int t = std::max(y - 1, 0);
  const int b = std::min(y + 1, gray.rows - 1);
  const auto* row = gray.ptr<float>(y);
  const float gx = r > l ? (row[r] - row[l]) / static_cast<float>(r - l) : 0;
  const float gy =
      b > t ? (gray.ptr<float>(b)[x] - gray.ptr<float>(t)[x]) / static_cast<float>(b - t) : 0;
  return {gx, gy};
}

void gradient_channels(const cv::Mat& gray, cv::Mat& values) {
  values.create(gray.size(), CV_32FC2);
  for (int y = 0; y < gray.rows; ++y) {
    auto* to = values.ptr<float>(y);
    for (int x = 0; x < gray.cols; ++x) {
      const Gradient g = gradient_at(gray, x, y);
      const float length = std::sqrt(g.x * g.x + g.y * g.y + kMinContrast * kMinContrast);
      to[2 * x] = g.x / length;
      to[2 * x + 1] = g.y / length;
    }
  }
}

void oriented_channels(const cv::Mat& gray, cv::Mat& energy, cv::Mat& contrast, cv::Mat& values) {
  constexpr float kHalf = 0.70710678F;
  values.create(gray.size(), CV_32FC(8));
  for (int y = 0; y < gray.rows; ++y) {
    auto* to = values.ptr<float>(y);
    for (int x = 0; x < gray.cols; ++x, to += 8) {
      const Gradient g = gradient_at(gray, x, y);
      const float d1 = kHalf * (g.x + g.y);
      const float d2 = kHalf * (g.y - g.x);
      to[0] = std::max(0.0F, g.x);
      to[1] = std::max(0.0F, d1);
      to[2] = std::max(0.0F, g.y);
      to[3] = std::max(0.0F, d2);
      to[4] = std::max(0.0F, -g.x);
      to[5] = std::max(0.0F, -d1);
      to[6] = std::max(0.0F, -g.y);
      to[7] = std::max(0.0F, -d2);
    }
  }
  cv::GaussianBlur(values, values, {}, kPooling, kPooling, cv::BORDER_REPLICATE);
  energy.create(gray.size(), CV_32FC1);
  for (int y = 0; y < gray.rows; ++y) {
    const auto* from = values.ptr<float>(y);
    auto* to = energy.ptr<float>(y);
    for (int x = 0; x < gray.cols; ++x, from += 8) {
      float sum = 0;
      for (int c = 0; c < 8; ++c) sum += from[c] * from[c];
      to[x] = sum;
    }
  }
  cv::GaussianBlur(energy, contrast, {}, kContrast, kContrast, cv::BORDER_REPLICATE);
  for (int y = 0; y < gray.rows; ++y) {
    const auto* sum = contrast.ptr<float>(y);
    auto* to = values.ptr<float>(y);
    for (int x = 0; x < gray.cols; ++x, to += 8) {
      const float factor = 1 / std::sqrt(sum[x] + kMinContrast * kMinContrast);
      for (int c = 0; c < 8; ++c) to[c] *= factor;
    }
  }
}

}  // namespace

int channel_count(Channels channels) {
  switch (channels) {
    case Channels::kGrey:
      return 1;
    case Channels::kColour:
      return 3;
    case Channels::kGradient:
      return 2;
    case Channels::kOriented:
      return 8;
  }
  return 0;
}

std::string_view name_of(Channels channels) { return kChannels.name(channels); }

Channels parse_channels(std::string_view name) { return kChannels.parse(name); }

bool has_offset(Channels channels) {
  return channels == Channels::kGrey || channels == Channels::kColour;
}

void make_upright_crop(const cv::Mat& image, const shape::Similarity2d& image_from_crop,
                       cv::Size size, Channels channels, UprightCrop& upright) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC1 || image.type() == CV_8UC3),
                  "an image of OpenCV's type {}", image.type());
  TARSIER_REQUIRE(size.width >= 2 && size.height >= 2 && size.width <= 8000 && size.height <= 8000,
                  "a crop of {} x {}", size.width, size.height);
  auto& [reduced, crop, gray, energy] = upright.buffers;
  if (!cut(image, image_from_crop, size, reduced, crop)) {
    crop.create(size, image.type());
    crop.setTo(0);
  }
  mark_inside(image.size(), image_from_crop, size, upright.inside);
  if (channels == Channels::kColour) {
    if (crop.channels() == 1) cv::cvtColor(crop, crop, cv::COLOR_GRAY2BGR);
    crop.convertTo(upright.values, CV_32F);
    return;
  }
  if (crop.channels() == 3) cv::cvtColor(crop, crop, cv::COLOR_BGR2GRAY);
  if (channels == Channels::kGrey) {
    crop.convertTo(upright.values, CV_32F);
    return;
  }
  crop.convertTo(gray, CV_32F);
  cv::GaussianBlur(gray, gray, {}, kSmoothing, kSmoothing, cv::BORDER_REPLICATE);
  if (channels == Channels::kGradient)
    gradient_channels(gray, upright.values);
  else
    oriented_channels(gray, energy, gray, upright.values);
}

}  // namespace tarsier::face::appearance
