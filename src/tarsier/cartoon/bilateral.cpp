// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/bilateral.h"

#include "tarsier/cartoon/rows.h"
#include "tarsier/core/image.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace tarsier::cartoon {
namespace {

double gaussian(double squared_distance, double sigma) {
  return std::exp(-squared_distance / (2 * sigma * sigma));
}

int quantized(double weight) { return static_cast<int>(std::lround(weight)); }

// The table of one ring: spatial times colour weight, in steps of 1 / center.
void append_weights(const PaintOptions& options, int center, int squared_radius,
                    std::vector<std::uint8_t>& weights) {
  for (int d = 0; d < kBilateralTable; ++d) {
    const double weight = center * gaussian(squared_radius, options.sigma_space) *
                          gaussian(d * d, options.sigma_color);
    weights.push_back(static_cast<std::uint8_t>(quantized(weight)));
  }
}

// The maximum weight, at most 127, for which no sum of weight times difference exceeds 16 bits.
int center_weight(const PaintOptions& options) {
  const int radius = options.diameter / 2;
  std::vector<std::uint8_t> weights;
  for (int center = 127; center > 0; --center) {
    int worst = 0;
    for (int dy = -radius; dy <= radius; ++dy) {
      for (int dx = -radius; dx <= radius; ++dx) {
        const int squared = dx * dx + dy * dy;
        if (squared == 0 || squared > radius * radius) continue;
        weights.clear();
        append_weights(options, center, squared, weights);
        int largest = 0;
        for (int d = 0; d < kBilateralTable; ++d) {
          largest = std::max(largest, d * weights[static_cast<size_t>(d)]);
        }
        worst += largest;
      }
    }
    if (worst <= 32767) return center;
  }
  return 0;
}

}  // namespace

bool BilateralPainter::supports(const PaintOptions& options) {
  constexpr int kCoarsest = 48;  // with fewer steps, the weights do not give the same image
  const int center = center_weight(options);
  return center >= kCoarsest &&
         quantized(center * gaussian(kBilateralTable * kBilateralTable, options.sigma_color)) == 0;
}

void BilateralPainter::prepare(const PaintOptions& options, std::ptrdiff_t stride) {
  const Prepared required{options.diameter, options.sigma_color, options.sigma_space, stride};
  if (required == prepared_) return;
  prepared_ = required;
  radius_ = options.diameter / 2;
  weights_.clear();
  ring_end_.clear();
  offsets_.clear();
  const int center = center_weight(options);
  for (int squared = 1; squared <= radius_ * radius_; ++squared) {
    const size_t before = offsets_.size();
    // One half of the ring; the other half is its point reflection.
    for (int dy = 0; dy <= radius_; ++dy) {
      for (int dx = dy == 0 ? 1 : -radius_; dx <= radius_; ++dx) {
        if (dx * dx + dy * dy != squared) continue;
        const std::ptrdiff_t offset = dy * stride + dx;
        offsets_.push_back(-offset);
        offsets_.push_back(offset);
      }
    }
    if (offsets_.size() == before) continue;
    ring_end_.push_back(static_cast<int>(offsets_.size() / 2));
    append_weights(options, center, squared, weights_);
  }
  prepare_quads();
  taps_ = {static_cast<int>(ring_end_.size()),
           weights_.data(),
           ring_end_.data(),
           offsets_.data(),
           center,
           stride,
           quads_.empty() ? nullptr : quads_.data()};
}

void BilateralPainter::prepare_quads() {
  quads_.clear();
  if (radius_ != 4) return;
  std::map<int, const std::uint8_t*> table_of;  // by squared radius
  for (int squared = 1; squared <= radius_ * radius_; ++squared) {
    for (int dy = 0; dy <= radius_; ++dy) {
      for (int dx = 0; dx <= dy; ++dx) {
        if (dx * dx + dy * dy != squared || table_of.contains(squared)) continue;
        table_of[squared] = weights_.data() + table_of.size() * kBilateralTable;
      }
    }
  }
  for (const auto& [squared, table] : table_of) {
    if (table[kBilateralTable - 1] != 0) return;  // it represents all larger distances
  }
  const auto add = [&](std::initializer_list<cv::Point> neighbours) {
    for (const cv::Point& at : neighbours) {
      const std::uint8_t* const table = table_of.at(at.x * at.x + at.y * at.y);
      quads_.insert(quads_.end(), table, table + kBilateralTable);
    }
  };
  add({{-4, 0}, {-3, 0}, {-2, 0}, {-1, 0}});
  add({{1, 0}, {2, 0}, {3, 0}, {4, 0}});
  add({{-2, 3}, {-1, 3}, {0, 3}, {1, 3}});
  add({{0, -4}, {0, 4}, {2, -3}, {2, 3}});
  for (int dx = 0; dx <= 3; ++dx) add({{dx, 2}, {dx, 1}});
}

void BilateralPainter::filter_row(const Kernels& kernels, const Image& from, int y_from, Image& to,
                                  int y_to) const {
  const std::uint8_t* const src[3] = {from[0].row(y_from), from[1].row(y_from),
                                      from[2].row(y_from)};
  std::uint8_t* const dst[3] = {to[0].row(y_to), to[1].row(y_to), to[2].row(y_to)};
  kernels.bilateral_row(taps_, src, dst, from[0].width());
  for (Plane& plane : to) plane.extend_row_by_reflection(y_to, radius_);
}

void BilateralPainter::filter(const Kernels& kernels, const Image& from, Image& to) {
  for_row_bands(from[0].height(), [&](int first, int last) {
    for (int y = first; y < last; ++y) filter_row(kernels, from, y, to, y);
  });
  for (Plane& plane : to) plane.extend_height_by_reflection(radius_);
}

// Two passes with one hand-over to the threads, which on small images costs as much as several
// rows. Each band also computes the few extra rows that its second pass reads, in an image of its
// own.
void BilateralPainter::filter_twice(const Kernels& kernels, const Image& from, Image& to) {
  const int width = from[0].width();
  const int height = from[0].height();
  between_.resize(std::max(between_.size(), static_cast<size_t>(number_of_bands(height))));
  for_row_bands(height, [&](int band, int first, int last) {
    Image& between = between_[static_cast<size_t>(band)];
    const int top = std::max(0, first - radius_);
    const int bottom = std::min(height, last + radius_);
    for (Plane& plane : between) plane.resize(width, bottom - top);
    for (int y = top; y < bottom; ++y) filter_row(kernels, from, y, between, y - top);
    // Has an effect only if the band ends at the image's border; elsewhere these rows are not read.
    for (Plane& plane : between) plane.extend_height_by_reflection(radius_);
    for (int y = first; y < last; ++y) filter_row(kernels, between, y - top, to, y);
  });
  for (Plane& plane : to) plane.extend_height_by_reflection(radius_);
}

void BilateralPainter::paint(cv::Mat& image, const PaintOptions& options, int passes) {
  paint_with(kernels(), image, options, passes);
}

void BilateralPainter::paint_with(const Kernels& kernels, cv::Mat& image,
                                  const PaintOptions& options, int passes) {
  require_bgr(image);
  TARSIER_REQUIRE(supports(options), "sigma_color {} is too large", options.sigma_color);
  if (passes <= 0) return;
  for (int c = 0; c < 3; ++c) {
    front_.at(static_cast<size_t>(c)).resize(image.cols, image.rows);
    back_.at(static_cast<size_t>(c)).resize(image.cols, image.rows);
  }
  prepare(options, front_[0].stride());

  for_row_bands(image.rows, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      std::uint8_t* const planes[3] = {front_[0].row(y), front_[1].row(y), front_[2].row(y)};
      kernels.split_row(image.ptr(y), planes, image.cols);
      for (Plane& plane : front_) plane.extend_row_by_reflection(y, radius_);
    }
  });
  for (Plane& plane : front_) plane.extend_height_by_reflection(radius_);

  for (int left = passes; left > 0; left -= 2) {
    left > 1 ? filter_twice(kernels, front_, back_) : filter(kernels, front_, back_);
    std::swap(front_, back_);
  }

  for_row_bands(image.rows, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      const std::uint8_t* const planes[3] = {front_[0].row(y), front_[1].row(y), front_[2].row(y)};
      kernels.join_row(planes, image.ptr(y), image.cols);
    }
  });
}

}  // namespace tarsier::cartoon
