// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/landmarks/trees.h"
#include "tarsier/face/landmarks/trees_inner.h"
#include "tarsier/face/shape/similarity.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::face::landmarks {

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
    TARSIER_REQUIRE(level.leaves.size() == trees * (nodes + 1) * 2 * n,
                    "level {}: {} numbers in leaves, {} are due", l, level.leaves.size(),
                    trees * (nodes + 1) * 2 * n);
    TARSIER_REQUIRE(std::isfinite(level.step) && level.step > 0 && level.step <= 1,
                    "level {}: step {} is not in (0, 1]", l, level.step);
  }
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
  const std::uint8_t* pixels = gray.ptr<std::uint8_t>();
  const std::size_t stride = gray.step[0];
  // Written so that what is not a number becomes 0.
  const auto nearest = [](float value, float last) {
    const float within = value > 0 ? (value < last ? value : last) : 0.0F;
    return static_cast<std::size_t>(static_cast<int>(within + 0.5F));
  };
  const float apart = std::max(1.0F, smoothing * std::hypot(a, b));
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
    const std::size_t columns[] = {nearest(x - apart, right), nearest(x, right),
                                   nearest(x + apart, right)};
    int sum = 4;
    for (int line = -1; line <= 1; ++line) {
      const std::uint8_t* row =
          pixels + nearest(y + static_cast<float>(line) * apart, bottom) * stride;
      sum += row[columns[0]] + row[columns[1]] + row[columns[2]];
    }
    values[i] = static_cast<std::uint8_t>(sum / 9);
  }
}

namespace {

// sum += leaf: whole numbers, so that the order of adding does not matter.
void add(const std::int16_t* leaf, std::size_t size, std::int32_t* sum) {
  for (std::size_t i = 0; i < size; ++i) sum[i] += leaf[i];
}

}  // namespace
}  // namespace inner

Eigen::Matrix2Xd fit_trees(const Trees& model, const cv::Mat& gray, const Eigen::Matrix2Xd& start) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "the image is not 8 bit gray");
  TARSIER_REQUIRE(start.cols() == model.mean.cols(), "{} points, the model has {}", start.cols(),
                  model.mean.cols());
  TARSIER_REQUIRE(start.allFinite(), "a point of the start is not finite");
  const shape::Similarity2d px_from_mean = shape::fit_similarity(model.mean, start);
  TARSIER_REQUIRE(px_from_mean.scale() > 0, "the start has no size");
  Eigen::Matrix2Xd current = px_from_mean.inverse()(start);

  const auto numbers = static_cast<std::size_t>(2 * model.mean.cols());
  const std::size_t nodes = (std::size_t{1} << model.depth) - 1;
  std::vector<std::uint8_t> values;
  std::vector<const std::int16_t*> leaves;
  std::vector<std::int32_t> sum(numbers);
  for (const Trees::Level& level : model.levels) {
    values.resize(level.anchor.size());
    inner::look_up(level, model.smoothing, gray,
                   px_from_mean * shape::fit_similarity(model.mean, current), px_from_mean(current),
                   values.data());
    // All walks first: they do not wait for each other, and the leaves are on their way from memory
    // when they are added.
    const std::size_t trees = level.first.size() / nodes;
    leaves.resize(trees);
    for (std::size_t t = 0; t < trees; ++t) {
      const int leaf = inner::leaf_of(level, static_cast<int>(t), model.depth, values.data());
      leaves[t] =
          level.leaves.data() + (t * (nodes + 1) + static_cast<std::size_t>(leaf)) * numbers;
      for (std::size_t i = 0; i < numbers; i += 32) __builtin_prefetch(leaves[t] + i);
    }
    std::fill(sum.begin(), sum.end(), 0);
    for (const std::int16_t* leaf : leaves) inner::add(leaf, numbers, sum.data());
    const double step = level.step;
    for (Eigen::Index i = 0; i < current.size(); ++i)
      current.data()[i] += step * sum[static_cast<std::size_t>(i)];
  }
  return px_from_mean(current);
}

}  // namespace tarsier::face::landmarks
