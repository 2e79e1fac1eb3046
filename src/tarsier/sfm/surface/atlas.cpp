// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/atlas.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>

namespace tarsier::sfm {
namespace {

struct Step {
  int x = 0;
  int width = 0;
  int y = 0;  // rows from here on are free
};

class Skyline {
 public:
  explicit Skyline(int side) : side_(side), steps_{{0, side, 0}} {}

  std::optional<cv::Point> place(const cv::Size& size) {
    if (size.width > side_ || size.height > side_) return std::nullopt;
    int best_bottom = std::numeric_limits<int>::max();
    std::size_t best = steps_.size();
    int best_y = 0;
    for (std::size_t i = 0; i < steps_.size() && steps_[i].x + size.width <= side_; ++i) {
      int y = 0;
      int reached = steps_[i].x;
      for (std::size_t j = i; reached < steps_[i].x + size.width; ++j) {
        y = std::max(y, steps_[j].y);
        reached = steps_[j].x + steps_[j].width;
        if (y + size.height >= best_bottom) break;
      }
      if (y + size.height > side_ || y + size.height >= best_bottom) continue;
      best_bottom = y + size.height;
      best = i;
      best_y = y;
    }
    if (best == steps_.size()) return std::nullopt;
    const cv::Point corner(steps_[best].x, best_y);
    cover(best, corner, size);
    return corner;
  }

 private:
  void cover(std::size_t at, const cv::Point& corner, const cv::Size& size) {
    const int end = corner.x + size.width;
    std::size_t last = at;
    while (last < steps_.size() && steps_[last].x + steps_[last].width <= end) ++last;
    if (last < steps_.size() && steps_[last].x < end) {
      steps_[last].width -= end - steps_[last].x;
      steps_[last].x = end;
    }
    const auto begin = steps_.begin() + static_cast<std::ptrdiff_t>(at);
    steps_.erase(begin, steps_.begin() + static_cast<std::ptrdiff_t>(last));
    steps_.insert(steps_.begin() + static_cast<std::ptrdiff_t>(at),
                  {corner.x, size.width, corner.y + size.height});
  }

  int side_;
  std::vector<Step> steps_;
};

}  // namespace

std::optional<std::vector<cv::Point>> pack(const std::vector<cv::Size>& sizes, int side) {
  std::int64_t area = 0;
  for (const cv::Size& size : sizes) area += std::int64_t{size.width} * size.height;
  if (area > std::int64_t{side} * side) return std::nullopt;
  std::vector<std::size_t> order(sizes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return sizes[a].height != sizes[b].height ? sizes[a].height > sizes[b].height
                                              : sizes[a].width > sizes[b].width;
  });
  Skyline skyline(side);
  std::vector<cv::Point> corners(sizes.size());
  for (const std::size_t i : order) {
    const auto corner = skyline.place(sizes[i]);
    if (!corner) return std::nullopt;
    corners[i] = *corner;
  }
  return corners;
}

}  // namespace tarsier::sfm
