// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene_texture.h"

#include <opencv2/imgproc.hpp>

#include <array>
#include <numbers>
#include <utility>

namespace tarsier::synth {
namespace {

// Adds one octave of value noise: random values `cell` texels apart with smooth interpolation.
// `grid` has one more row and column than the number of cells.
void add_octave(cv::Mat1f& plane, const cv::Mat1f& grid, double cell, float amplitude) {
  std::vector<int> index(static_cast<std::size_t>(plane.cols));
  std::vector<float> weight(index.size());
  const auto place = [cell](int at, int last) {
    const double x = (at + 0.5) / cell;
    const int i = std::min(static_cast<int>(x), last);
    const double f = std::min(x - i, 1.0);
    return std::pair{i, static_cast<float>(f * f * (3 - 2 * f))};
  };
  for (int x = 0; x < plane.cols; ++x) {
    const auto column = static_cast<std::size_t>(x);
    std::tie(index[column], weight[column]) = place(x, grid.cols - 2);
  }
  cv::parallel_for_(cv::Range(0, plane.rows), [&](const cv::Range& rows) {
    std::vector<float> line(static_cast<std::size_t>(grid.cols));
    for (int y = rows.start; y < rows.end; ++y) {
      const auto [row, down] = place(y, grid.rows - 2);
      const float* above = grid[row];
      const float* below = grid[row + 1];
      for (int i = 0; i < grid.cols; ++i) {
        line[static_cast<std::size_t>(i)] = amplitude * (above[i] + down * (below[i] - above[i]));
      }
      float* out = plane[y];
      for (int x = 0; x < plane.cols; ++x) {
        const auto column = static_cast<std::size_t>(x);
        const float* left = line.data() + index[column];
        out[x] += left[0] + weight[column] * (left[1] - left[0]);
      }
    }
  });
}

// Random values for cells of `cell` units. Their number does not depend on the resolution, so the
// scene is the same at every size of the images.
cv::Mat1f random_grid(double width, double height, double cell, Rng rng) {
  cv::Mat1f grid(static_cast<int>(std::ceil(height / cell - 1e-9)) + 1,
                 static_cast<int>(std::ceil(width / cell - 1e-9)) + 1);
  for (float& value : grid) value = static_cast<float>(rng.uniform(-1, 1));
  return grid;
}

cv::Scalar random_colour(Rng& rng) {
  // Dark or light, seldom in between, so that shapes stand out.
  const double level = rng.uniform() < 0.5 ? rng.uniform(8, 90) : rng.uniform(165, 248);
  cv::Scalar colour;
  for (int c = 0; c < 3; ++c) colour[c] = std::clamp(level + rng.uniform(-45, 45), 0.0, 255.0);
  return colour;
}

// Draws one small shape at a random position of an image with `scale` texels per unit.
void draw_shape(cv::Mat& image, double width, double height, double scale, Rng& rng) {
  constexpr int kBits = 4;  // fractional bits of texels in OpenCV's drawing
  const auto fixed = [&](double x, double y) {
    return cv::Point(static_cast<int>(std::lround((x * scale - 0.5) * (1 << kBits))),
                     static_cast<int>(std::lround((y * scale - 0.5) * (1 << kBits))));
  };
  const double x = rng.uniform(0, width);
  const double y = rng.uniform(0, height);
  const double radius = 0.035 * std::exp(rng.uniform() * std::log(14.0));  // up to 0.49 units
  const double turn = rng.uniform(0, 2 * std::numbers::pi);
  const double slim = rng.uniform(0.35, 1);
  const int kind = rng.integer(0, 4);
  const cv::Scalar colour = random_colour(rng);
  const cv::Scalar second = random_colour(rng);
  const auto blob = [&](double size, const cv::Scalar& fill) {
    cv::circle(image, fixed(x, y), static_cast<int>(std::lround(size * scale * (1 << kBits))), fill,
               cv::FILLED, cv::LINE_AA, kBits);
  };
  const auto polygon = [&](int corners, double size, const cv::Scalar& fill) {
    std::vector<cv::Point> points;
    for (int k = 0; k < corners; ++k) {
      const double a = 2 * std::numbers::pi * (k + 0.5) / corners;
      const double u = size * std::cos(a);
      const double v = size * slim * std::sin(a);
      points.push_back(fixed(x + u * std::cos(turn) - v * std::sin(turn),
                             y + u * std::sin(turn) + v * std::cos(turn)));
    }
    cv::fillConvexPoly(image, points, fill, cv::LINE_AA, kBits);
  };
  if (kind == 0) {
    blob(radius, colour);
  } else if (kind == 1) {
    blob(radius, colour);
    blob(radius * slim * 0.8, second);
  } else {
    polygon(kind + 1, radius * 1.2, colour);
    if (radius > 0.15) polygon(kind + 1, radius * 0.55, second);
  }
}

}  // namespace

Texture::Texture(double width, double height, double texels_per_unit, const Rng& base)
    : scale_(std::max(1.0, std::round(width * texels_per_unit / 16)) * 16 / width) {
  const cv::Size size(static_cast<int>(std::lround(width * scale_)),
                      static_cast<int>(std::lround(height * scale_)));
  cv::Mat1f grey(size, 0.0F);
  std::array<cv::Mat1f, 2> tint{cv::Mat1f(size, 0.0F), cv::Mat1f(size, 0.0F)};
  std::uint64_t stream = 0;
  for (double cell = 3.2; cell > 0.02; cell /= 2) {
    ++stream;
    if (cell > 2 * width || cell * scale_ < 2) continue;
    add_octave(grey, random_grid(width, height, cell, base.fork(stream)), cell * scale_,
               static_cast<float>(0.62 * std::pow(cell, 0.22)));
    if (cell > 1.7 || cell < 0.15) continue;
    for (std::uint64_t k = 0; k < 2; ++k) {
      add_octave(tint[k], random_grid(width, height, cell, base.fork(100 * (k + 1) + stream)),
                 cell * scale_, 0.16F);
    }
  }
  cv::Mat image(size, CV_8UC3);
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      auto* out = image.ptr<cv::Vec3b>(y);
      for (int x = 0; x < size.width; ++x) {
        const float g = grey(y, x) * 1.5F;
        const float level = 128 + 112 * g / std::sqrt(1 + g * g);
        const float warm = 128 * tint[0](y, x);
        const float green = 80 * tint[1](y, x);
        out[x] = {cv::saturate_cast<std::uint8_t>(level - warm),
                  cv::saturate_cast<std::uint8_t>(level + green),
                  cv::saturate_cast<std::uint8_t>(level + warm)};
      }
    }
  });
  Rng rng = base.fork(999);
  const int shapes = static_cast<int>(std::lround(5 * width * height));
  for (int i = 0; i < shapes; ++i) draw_shape(image, width, height, scale_, rng);
  cv::GaussianBlur(image, image, {3, 3}, 0.6);
  levels_.push_back(image);
  while (levels_.size() < 6 && levels_.back().cols % 2 == 0 && levels_.back().rows % 2 == 0) {
    cv::Mat half;
    cv::resize(levels_.back(), half, {}, 0.5, 0.5, cv::INTER_AREA);
    levels_.push_back(half);
  }
}

}  // namespace tarsier::synth
