// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/regression/trees.h"
#include "tarsier/face/shape/similarity.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <cstdint>

// Functions shared by training and fitting. Internal to this module.
namespace tarsier::face::regression::inner {

// The grey values of a level's pixels. Each pixel is at its anchor (`points`, px) plus its offset,
// rotated and scaled by `px_from_mean`. The value is that of the nearest pixel, or the mean of the
// nearest pixels of 3 x 3 samples that are `smoothing` of the shape's size apart. Outside the
// image, the nearest border pixel is used.
void look_up(const Trees::Level& level, float smoothing, const cv::Mat& gray,
             const shape::Similarity2d& px_from_mean, const Eigen::Matrix2Xd& points,
             std::uint8_t* values);

// Number of trees of a level.
inline int tree_count(const Trees::Level& level, int depth) {
  const auto inner_nodes = static_cast<std::size_t>((1 << depth) - 1);
  return static_cast<int>(level.first.size() / inner_nodes);
}

// The leaf (0 .. 2^depth - 1) of tree `tree` that the values of look_up() lead to.
inline int leaf_of(const Trees::Level& level, int tree, int depth, const std::uint8_t* values) {
  const int inner_nodes = (1 << depth) - 1;
  const auto base = static_cast<std::size_t>(tree) * static_cast<std::size_t>(inner_nodes);
  int node = 0;
  for (int k = 0; k < depth; ++k) {
    const std::size_t i = base + static_cast<std::size_t>(node);
    const int difference = values[level.first[i]] - values[level.second[i]];
    node = 2 * node + 1 + static_cast<int>(difference > level.threshold[i]);
  }
  return node - inner_nodes;
}

// Adds the leaves that the values of look_up() lead to: components() sums. They are integers, so
// the order of addition does not matter.
void add_leaves(const Trees::Level& level, int depth, const std::uint8_t* values,
                std::int32_t* sums);

}  // namespace tarsier::face::regression::inner
