// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <unordered_map>
#include <vector>

namespace tarsier::sfm {

// Points in a grid of cells, for nearest neighbour search. Internal to this module.
class PointGrid {
 public:
  // `cell`: side of a cell, > 0.
  PointGrid(std::vector<cv::Vec3f> points, float cell);

  // Distance of the nearest point, at most `limit`.
  [[nodiscard]] float distance(const cv::Vec3f& from, float limit) const;
  [[nodiscard]] const std::vector<cv::Vec3f>& points() const { return points_; }

 private:
  struct Range {
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
  };
  [[nodiscard]] cv::Vec3i cell_of(const cv::Vec3f& point) const;

  std::vector<cv::Vec3f> points_;  // in the order of their cells
  float cell_;
  std::unordered_map<std::uint64_t, Range> cells_;
};

// The first point of each cell.
[[nodiscard]] std::vector<cv::Vec3f> voxel_downsampled(const std::vector<cv::Vec3f>& points,
                                                       float cell);

}  // namespace tarsier::sfm
