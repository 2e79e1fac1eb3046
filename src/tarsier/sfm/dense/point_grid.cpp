// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/point_grid.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_set>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kBias = 1 << 20;  // cells on each side of the origin

std::uint64_t key_of(const cv::Vec3i& cell) {
  std::uint64_t key = 0;
  for (int k = 0; k < 3; ++k) {
    const int index = std::clamp(cell[k] + kBias, 0, 2 * kBias - 1);
    key = key << 21 | static_cast<std::uint64_t>(index);
  }
  return key;
}

cv::Vec3i cell_at(const cv::Vec3f& point, float cell) {
  cv::Vec3i result;
  for (int k = 0; k < 3; ++k) {
    const float index = std::floor(point[k] / cell);
    result[k] = static_cast<int>(std::clamp(index, -1e6F, 1e6F));
  }
  return result;
}

}  // namespace

PointGrid::PointGrid(std::vector<cv::Vec3f> points, float cell) : cell_(cell) {
  TARSIER_REQUIRE(cell > 0 && std::isfinite(cell), "cells of {}", cell);
  TARSIER_REQUIRE(points.size() < std::numeric_limits<std::uint32_t>::max(), "{} points",
                  points.size());
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order;
  order.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    order.emplace_back(key_of(cell_of(points[i])), static_cast<std::uint32_t>(i));
  std::sort(order.begin(), order.end());
  points_.reserve(points.size());
  for (const auto& [key, index] : order) {
    const auto position = static_cast<std::uint32_t>(points_.size());
    Range& range = cells_.try_emplace(key, Range{position, position}).first->second;
    range.end = position + 1;
    points_.push_back(points[index]);
  }
}

cv::Vec3i PointGrid::cell_of(const cv::Vec3f& point) const { return cell_at(point, cell_); }

float PointGrid::distance(const cv::Vec3f& from, float limit) const {
  const cv::Vec3i center_cell = cell_of(from);
  const int reach = static_cast<int>(std::ceil(limit / cell_));
  float best = limit * limit;
  // Visits shells of cells around the centre: shell r + 1 is at least r cells away.
  for (int r = 0; r <= reach; ++r) {
    const float nearest = static_cast<float>(r - 1) * cell_;
    if (r > 1 && nearest * nearest >= best) break;
    for (int z = -r; z <= r; ++z) {
      for (int y = -r; y <= r; ++y) {
        const bool is_side = std::abs(z) == r || std::abs(y) == r;
        for (int x = -r; x <= r; x += is_side || r == 0 ? 1 : 2 * r) {
          const auto found = cells_.find(key_of(center_cell + cv::Vec3i(x, y, z)));
          if (found == cells_.end()) continue;
          for (std::uint32_t i = found->second.begin; i < found->second.end; ++i) {
            const cv::Vec3f between = points_[i] - from;
            best = std::min(best, between.dot(between));
          }
        }
      }
    }
  }
  return std::sqrt(best);
}

std::vector<cv::Vec3f> voxel_downsampled(const std::vector<cv::Vec3f>& points, float cell) {
  TARSIER_REQUIRE(cell > 0 && std::isfinite(cell), "cells of {}", cell);
  std::unordered_set<std::uint64_t> occupied;
  std::vector<cv::Vec3f> result;
  for (const cv::Vec3f& point : points)
    if (occupied.insert(key_of(cell_at(point, cell))).second) result.push_back(point);
  return result;
}

}  // namespace tarsier::sfm
