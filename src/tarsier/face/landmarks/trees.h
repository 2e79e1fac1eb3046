// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Ensemble of regression trees (Kazemi and Sullivan, "One millisecond face alignment with an
// ensemble of regression trees", CVPR 2014): a cascade of gradient-boosted trees that compare pairs
// of pixels indexed relative to the current shape.
namespace tarsier::face::landmarks {

struct TreesOptions {
  int levels = 15;          // of the cascade
  int trees = 500;          // a level
  int depth = 3;            // splits from root to leaf
  double shrinkage = 0.1;   // nu
  int features = 400;       // pixels a level that can be compared
  int tests = 24;           // random splits tried at a node
  double nearness = 0.12;   // lambda of the exponential prior on the distance of compared pixels,
                            // in units of the mean shape's size
  double padding = 0.03;    // pixels are drawn from the mean shape's box grown by this share
  double smoothing = 0.03;  // distance of the 3 x 3 samples that a pixel's value is the mean of, in
                            // sizes of the current shape (at least 1 px); 0: one sample
  int components = 24;      // numbers that a leaf is stored as, by PCA over the leaves of a level
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"levels", levels, range(1, 30), "--levels", "of the cascade of trees"},
            {"trees", trees, range(1, 2000), "--trees", "a level"},
            {"depth", depth, range(1, 8), "--depth", "of a tree"},
            {"shrinkage", shrinkage, above(0, 1)},
            {"features", features, range(10, 4000)},
            {"tests", tests, range(1, 1000)},
            {"nearness", nearness, above(0, 100)},
            {"padding", padding, range(0, 4)},
            {"smoothing", smoothing, range(0, 1)},
            {"components", components, range(1, 2000)}};
  }
  void check() const { check_fields(*this); }
};

struct Trees {
  Eigen::Matrix2Xd mean;  // 2 x n, the mean shape: centred, size 1
  int depth = 0;
  float smoothing = 0;  // as in the options
  struct Level {
    std::vector<std::int32_t> anchor;  // of each pixel: the nearest point of the mean
    Eigen::Matrix2Xf offset;           // 2 x features, from it, in the mean's frame
    // Trees one after the other; nodes of a tree in breadth-first order, 2^depth - 1 each.
    std::vector<std::int32_t> first;  // pixel, index into anchor
    std::vector<std::int32_t> second;
    std::vector<std::int16_t> threshold;  // go right when gray(first) - gray(second) > threshold
    // Leaves: 2^depth of each tree, `basis.cols()` whole numbers c each. A leaf moves the points by
    // basis c: 2n numbers (x0 y0 x1 ..), in the mean's frame.
    Eigen::MatrixXf basis;  // 2n x components
    std::vector<std::int8_t> leaves;

    [[nodiscard]] std::size_t components() const { return static_cast<std::size_t>(basis.cols()); }
    // Sets basis and leaves from the leaves' moves, 2n x leaves: the `max_components` directions in which
    // they vary most, each with a step of its own, 1/127 of its largest number.
    void set_leaves(const Eigen::MatrixXf& moves, int max_components);
    // The moves of all leaves, 2n x leaves.
    [[nodiscard]] Eigen::MatrixXf moves() const;
  };
  std::vector<Level> levels;
  [[nodiscard]] int points() const { return static_cast<int>(mean.cols()); }
  void check() const;
};

// Learns from all starts at once (several a face). In each level pixels are looked up relative to
// the current shape through the similarity that takes the mean to it; residuals are in the frame of
// the START's similarity to the mean, in which leaves are added. A level's leaves are compressed
// when it is done, and the next level learns from what is left then. The same result for any number
// of threads. Throws Interrupted, std::invalid_argument.
[[nodiscard]] Trees train_trees(const std::vector<TrainingFace>& faces,
                                const std::vector<Start>& starts, const TreesOptions& options,
                                Progress& progress, const std::stop_token& stop);

// The fit from `start` (px of `gray`, CV_8UC1). Pixels outside the image read as the nearest
// edge. Throws std::invalid_argument (another type, another number of points, no size).
[[nodiscard]] Eigen::Matrix2Xd fit_trees(const Trees& model, const cv::Mat& gray,
                                         const Eigen::Matrix2Xd& start);

[[nodiscard]] nlohmann::json to_json(const Trees& model);
[[nodiscard]] Trees trees_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::landmarks
