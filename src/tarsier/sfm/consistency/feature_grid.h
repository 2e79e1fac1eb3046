// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// The features of an image, indexed by position: sorted by the cells of a grid. Positions are
// inside the image.
class FeatureGrid {
 public:
  // Refers to `features`. `radius`: px, the search radius.
  FeatureGrid(const std::vector<cv::Point2f>& features, const geometry::Camera& camera,
              double radius)
      : features_(features),
        radius_(radius),
        side_(std::max(2 * radius, std::max(camera.width, camera.height) / kMaxColumns)),
        columns_(static_cast<int>(camera.width / side_) + 1),
        rows_(static_cast<int>(camera.height / side_) + 1),
        first_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0),
        sorted_(features.size()) {
    const auto cell = [&](const cv::Point2f& p) {
      return begin_of(row(static_cast<double>(p.y))) + column(static_cast<double>(p.x));
    };
    for (const cv::Point2f& p : features) ++first_[cell(p) + 1];
    for (std::size_t c = 1; c < first_.size(); ++c) first_[c] += first_[c - 1];
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    for (std::size_t f = 0; f < features.size(); ++f)
      sorted_[next[cell(features[f])]++] = static_cast<int>(f);
  }

  [[nodiscard]] double radius() const { return radius_; }

  // Calls `visit` with each feature within the radius, until it returns true. Returns whether it
  // did.
  template <typename Visit>
  [[nodiscard]] bool any(double x, double y, const Visit& visit) const {
    for (std::size_t r = row(y - radius_); r <= row(y + radius_); ++r) {
      const std::size_t end = first_[begin_of(r) + column(x + radius_) + 1];
      for (std::size_t k = first_[begin_of(r) + column(x - radius_)]; k < end; ++k) {
        const cv::Point2f& position = features_[static_cast<std::size_t>(sorted_[k])];
        const double dx = static_cast<double>(position.x) - x;
        const double dy = static_cast<double>(position.y) - y;
        if (dx * dx + dy * dy <= radius_ * radius_ && visit(sorted_[k])) return true;
      }
    }
    return false;
  }
  // Calls `visit` with each feature within the radius.
  template <typename Visit>
  void for_each(double x, double y, const Visit& visit) const {
    (void)any(x, y, [&](int feature) {
      visit(feature);
      return false;
    });
  }
  // Whether there is a feature within the radius.
  [[nodiscard]] bool has(double x, double y) const {
    return any(x, y, [](int /*feature*/) { return true; });
  }

 private:
  static constexpr double kMaxColumns = 2048;  // also max number of rows
  [[nodiscard]] std::size_t column(double x) const {
    return static_cast<std::size_t>(std::clamp(static_cast<int>(x / side_), 0, columns_ - 1));
  }
  [[nodiscard]] std::size_t row(double y) const {
    return static_cast<std::size_t>(std::clamp(static_cast<int>(y / side_), 0, rows_ - 1));
  }
  [[nodiscard]] std::size_t begin_of(std::size_t row) const {
    return row * static_cast<std::size_t>(columns_);
  }
  const std::vector<cv::Point2f>& features_;
  double radius_;
  double side_;  // px, of a cell
  int columns_;
  int rows_;
  std::vector<std::size_t> first_;  // for each cell, row by row: its begin in sorted_; and the end
  std::vector<int> sorted_;         // indices of features
};

}  // namespace tarsier::sfm
