// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/regression/trees.h"
#include "tarsier/face/regression/trees_inner.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::face::regression {

void Trees::check() const {
  const auto n = static_cast<std::size_t>(mean.cols());
  TARSIER_REQUIRE(n >= 2 && n <= 1000, "mean: {} points, 2..1000 are possible", n);
  TARSIER_REQUIRE(mean.allFinite(), "mean: a coordinate is not finite");
  TARSIER_REQUIRE(mean.rowwise().mean().norm() < 1e-3, "mean: not centred");
  TARSIER_REQUIRE(std::abs(shape_size(mean) - 1) < 1e-3, "mean: the size is not 1");
  TARSIER_REQUIRE(depth >= 1 && depth <= 8, "depth {}, 1..8 is possible", depth);
  TARSIER_REQUIRE(smoothing >= 0 && smoothing <= 1, "smoothing {} is not in 0..1", smoothing);
  TARSIER_REQUIRE(!levels.empty() && levels.size() <= 30, "{} levels, 1..30 are possible",
                  levels.size());
  const std::size_t nodes = (std::size_t{1} << depth) - 1;
  for (std::size_t l = 0; l < levels.size(); ++l) {
    const Level& level = levels[l];
    const std::size_t pixels = level.anchor.size();
    TARSIER_REQUIRE(pixels >= 1 && pixels <= 4000, "level {}: {} pixels, 1..4000 are possible", l,
                    pixels);
    TARSIER_REQUIRE(std::all_of(level.anchor.begin(), level.anchor.end(),
                                [&](int a) { return a >= 0 && static_cast<std::size_t>(a) < n; }),
                    "level {}: an anchor is none of the {} points", l, n);
    TARSIER_REQUIRE(static_cast<std::size_t>(level.offset.cols()) == pixels,
                    "level {}: {} offsets for {} pixels", l, level.offset.cols(), pixels);
    TARSIER_REQUIRE(level.offset.allFinite() && level.offset.cwiseAbs().maxCoeff() <= 100,
                    "level {}: an offset is beyond 100 sizes", l);
    const std::size_t trees = level.first.size() / nodes;
    TARSIER_REQUIRE(trees >= 1 && trees <= 2000 && level.first.size() == trees * nodes,
                    "level {}: {} nodes are not 1..2000 trees of {}", l, level.first.size(), nodes);
    TARSIER_REQUIRE(
        level.second.size() == level.first.size() && level.threshold.size() == level.first.size(),
        "level {}: {} and {} pixels with {} thresholds", l, level.first.size(), level.second.size(),
        level.threshold.size());
    const auto known = [&](int i) { return i >= 0 && static_cast<std::size_t>(i) < pixels; };
    TARSIER_REQUIRE(std::all_of(level.first.begin(), level.first.end(), known) &&
                        std::all_of(level.second.begin(), level.second.end(), known),
                    "level {}: a node compares a pixel that is none of the {}", l, pixels);
    TARSIER_REQUIRE(static_cast<std::size_t>(level.basis.rows()) == 2 * n &&
                        level.components() >= 1 && level.components() <= 2 * n,
                    "level {}: a basis of {} x {} for {} points", l, level.basis.rows(),
                    level.basis.cols(), n);
    TARSIER_REQUIRE(level.basis.allFinite() && level.basis.cwiseAbs().maxCoeff() <= 1,
                    "level {}: a step of the basis is beyond 1 size", l);
    TARSIER_REQUIRE(level.leaves.size() == trees * (nodes + 1) * level.components(),
                    "level {}: {} numbers in leaves, {} are due", l, level.leaves.size(),
                    trees * (nodes + 1) * level.components());
  }
}

void Trees::Level::set_leaves(const Eigen::MatrixXf& moves, int max_components) {
  const Eigen::MatrixXd exact = moves.cast<double>();
  const linalg::SymmetricEigen directions = linalg::symmetric_eigen(exact * exact.transpose());
  const Eigen::Index kept = std::min<Eigen::Index>(max_components, moves.rows());
  basis = directions.vectors.rightCols(kept).cast<float>();
  const Eigen::MatrixXf numbers = basis.transpose() * moves;
  constexpr float kMaxQuantised = 127;
  leaves.resize(static_cast<std::size_t>(numbers.size()));
  Eigen::VectorXf step(kept);
  for (Eigen::Index k = 0; k < kept; ++k) {
    const float largest = numbers.cols() > 0 ? numbers.row(k).cwiseAbs().maxCoeff() : 0.F;
    step[k] = largest > 0 ? largest / kMaxQuantised : 1.F;
    basis.col(k) *= step[k];
  }
  for (Eigen::Index leaf = 0; leaf < numbers.cols(); ++leaf) {
    for (Eigen::Index k = 0; k < kept; ++k) {
      const float whole =
          std::clamp(std::round(numbers(k, leaf) / step[k]), -kMaxQuantised, kMaxQuantised);
      leaves[static_cast<std::size_t>(leaf * kept + k)] = static_cast<std::int8_t>(whole);
    }
  }
}

Eigen::MatrixXf Trees::Level::moves() const {
  const Eigen::Map<const Eigen::Matrix<std::int8_t, Eigen::Dynamic, Eigen::Dynamic>> numbers(
      leaves.data(), basis.cols(), static_cast<Eigen::Index>(leaves.size()) / basis.cols());
  return basis * numbers.cast<float>();
}

namespace inner {

void look_up(const Trees::Level& level, float smoothing, const cv::Mat& gray,
             const shape::Similarity2d& px_from_mean, const Eigen::Matrix2Xd& points,
             std::uint8_t* values) {
  const auto a = static_cast<float>(px_from_mean.a);
  const auto b = static_cast<float>(px_from_mean.b);
  const auto right = static_cast<float>(gray.cols - 1);
  const auto bottom = static_cast<float>(gray.rows - 1);
  const Eigen::Matrix2Xf at = points.cast<float>();
  const auto* pixels = gray.ptr<std::uint8_t>();
  const std::size_t stride = gray.step[0];
  // Written so that NaN becomes 0.
  const auto nearest = [](float value, float last) {
    const float within = value > 0 ? (value < last ? value : last) : 0.0F;
    return static_cast<std::size_t>(static_cast<int>(within + 0.5F));
  };
  const float spacing = std::max(1.0F, smoothing * std::hypot(a, b));
  for (std::size_t i = 0; i < level.anchor.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const float dx = level.offset(0, k);
    const float dy = level.offset(1, k);
    const float x = at(0, level.anchor[i]) + (a * dx - b * dy);
    const float y = at(1, level.anchor[i]) + (b * dx + a * dy);
    if (smoothing <= 0) {
      values[i] = pixels[nearest(y, bottom) * stride + nearest(x, right)];
      continue;
    }
    const std::size_t columns[] = {nearest(x - spacing, right), nearest(x, right),
                                   nearest(x + spacing, right)};
    int sum = 4;
    for (int line = -1; line <= 1; ++line) {
      const std::uint8_t* row =
          pixels + nearest(y + static_cast<float>(line) * spacing, bottom) * stride;
      sum += row[columns[0]] + row[columns[1]] + row[columns[2]];
    }
    values[i] = static_cast<std::uint8_t>(sum / 9);
  }
}

void add_leaves(const Trees::Level& level, int depth, const std::uint8_t* values,
                std::int32_t* sums) {
  const std::size_t count = level.components();
  const std::size_t leaves = std::size_t{1} << depth;
  const int trees = tree_count(level, depth);
  for (int t = 0; t < trees; ++t) {
    const std::size_t leaf = static_cast<std::size_t>(t) * leaves +
                             static_cast<std::size_t>(leaf_of(level, t, depth, values));
    const std::int8_t* numbers = level.leaves.data() + leaf * count;
    for (std::size_t i = 0; i < count; ++i) sums[i] += numbers[i];
  }
}

}  // namespace inner

Eigen::Matrix2Xd fit_trees(const Trees& model, const cv::Mat& gray, const Eigen::Matrix2Xd& start,
                           std::vector<int>* last_leaves) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "the image is not 8 bit gray");
  TARSIER_REQUIRE(start.cols() == model.mean.cols(), "{} points, the model has {}", start.cols(),
                  model.mean.cols());
  TARSIER_REQUIRE(start.allFinite(), "a point of the start is not finite");
  const shape::Similarity2d px_from_mean = shape::fit_similarity(model.mean, start);
  TARSIER_REQUIRE(px_from_mean.scale() > 0, "the start has no size");
  Eigen::Matrix2Xd current = px_from_mean.inverse()(start);

  std::vector<std::uint8_t> values;
  Eigen::VectorXi sums;
  for (const Trees::Level& level : model.levels) {
    values.resize(level.anchor.size());
    inner::look_up(level, model.smoothing, gray,
                   px_from_mean * shape::fit_similarity(model.mean, current), px_from_mean(current),
                   values.data());
    sums.setZero(level.basis.cols());
    inner::add_leaves(level, model.depth, values.data(), sums.data());
    current.reshaped() += (level.basis * sums.cast<float>()).cast<double>();
  }
  if (last_leaves != nullptr) {
    last_leaves->clear();
    if (!model.levels.empty()) {
      const Trees::Level& last = model.levels.back();
      const int trees = inner::tree_count(last, model.depth);
      for (int t = 0; t < trees; ++t)
        last_leaves->push_back(inner::leaf_of(last, t, model.depth, values.data()));
    }
  }
  return px_from_mean(current);
}

}  // namespace tarsier::face::regression
