// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/regression/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Ensemble of regression trees (Kazemi and Sullivan, "One millisecond face alignment with an
// ensemble of regression trees", CVPR 2014): a cascade of gradient-boosted trees. Each node
// compares two pixels whose positions are relative to the current shape.
namespace tarsier::face::regression {

struct TreesOptions {
  int levels = 15;         // of the cascade
  int trees = 500;         // per level
  int depth = 3;           // splits from root to leaf
  double shrinkage = 0.1;  // nu
  int features = 400;      // pixels per level that can be compared
  int tests = 24;          // random splits tried per node
  // Lambda of the exponential prior on the distance of compared pixels, in units of the mean
  // shape's size.
  double nearness = 0.12;
  double padding = 0.03;  // pixels are drawn from the mean shape's box, extended by this share
  // Distance of the 3 x 3 samples whose mean is a pixel's value, in sizes of the current shape (at
  // least 1 px); 0: one sample.
  double smoothing = 0.03;
  // Coefficients per leaf, by PCA over the leaves of a level.
  int components = 24;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"levels", levels, range(1, 30), "--levels", "number of levels of the cascade"},
            {"trees", trees, range(1, 2000), "--trees", "number of trees a level"},
            {"depth", depth, range(1, 8), "--depth", "depth of a tree"},
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
    std::vector<std::int32_t> anchor;  // the nearest point of the mean, for each pixel
    Eigen::Matrix2Xf offset;           // 2 x features, relative to the anchor, in the mean's frame
    // Trees one after the other; nodes of a tree in breadth-first order, 2^depth - 1 each.
    std::vector<std::int32_t> first;  // pixel, index into anchor
    std::vector<std::int32_t> second;
    std::vector<std::int16_t> threshold;  // go right if gray(first) - gray(second) > threshold
    // Leaves: 2^depth per tree, `basis.cols()` integers c each. A leaf moves the points by basis c:
    // 2n numbers (x0 y0 x1 ..), in the mean's frame.
    Eigen::MatrixXf basis;  // 2n x components
    std::vector<std::int8_t> leaves;

    [[nodiscard]] std::size_t components() const { return static_cast<std::size_t>(basis.cols()); }
    // Sets basis and leaves from the leaves' displacements, 2n x leaves. Keeps the `max_components`
    // directions of greatest variance; each has its own step, 1/127 of its largest coefficient.
    void set_leaves(const Eigen::MatrixXf& moves, int max_components);
    // The displacements of all leaves, 2n x leaves.
    [[nodiscard]] Eigen::MatrixXf moves() const;
  };
  std::vector<Level> levels;
  [[nodiscard]] int points() const { return static_cast<int>(mean.cols()); }
  void check() const;
};

// Trains on all starts together (several per face). In each level, pixels are read relative to the
// current shape, through the similarity from the mean to it. Residuals are in the frame of the
// START's similarity to the mean; leaves are added in that frame. A level's leaves are compressed
// when it is complete, and the next level is trained on the remaining residuals. The result does
// not depend on the number of threads. Throws Interrupted, std::invalid_argument.
[[nodiscard]] Trees train_trees(const std::vector<TrainingFace>& faces,
                                const std::vector<Start>& starts, const TreesOptions& options,
                                Progress& progress, const std::stop_token& stop);

// The fit from `start` (px of `gray`, CV_8UC1). Pixels outside the image have the value of the
// nearest border pixel. `last_leaves` receives the leaf that each tree of the last level
// contributes (0 .. 2^depth - 1), in the order of the trees. Throws std::invalid_argument (wrong
// image type, number of points, or zero size).
[[nodiscard]] Eigen::Matrix2Xd fit_trees(const Trees& model, const cv::Mat& gray,
                                         const Eigen::Matrix2Xd& start,
                                         std::vector<int>* last_leaves = nullptr);

[[nodiscard]] nlohmann::json to_json(const Trees& model);
[[nodiscard]] Trees trees_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::regression
