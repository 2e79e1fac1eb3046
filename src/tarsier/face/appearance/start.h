// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

// Starts of a fit.
namespace tarsier::face::appearance {

// Medians over boxes and the points (2 x n) in them. Throws std::invalid_argument for an empty
// list.
[[nodiscard]] ShapeInBox learn_shape_in_box(
    const std::vector<std::pair<cv::Rect2d, Eigen::Matrix2Xd>>& boxes);

// The mean shape, or a shape b of the model, in a detector's box.
[[nodiscard]] Eigen::Matrix2Xd start_in_box(const AppearanceModel& model, const cv::Rect2d& box,
                                            const Eigen::VectorXd& b = {});

// The start, followed by rotated, scaled and shifted copies. `count` >= 1; the first is unchanged.
// `spread` 1: shifts of about 8 % of the size, 8 % of scale, 6 deg. Deterministic.
[[nodiscard]] std::vector<Eigen::Matrix2Xd> starts_around(const Eigen::Matrix2Xd& start, int count,
                                                          double spread = 1);

// A random start: the shape scaled by 1 +- scale, rotated by +- angle_deg and shifted by +- shift
// times its width and height, each uniform.
struct Disturbance {
  double scale = 0.1;
  double angle_deg = 10;
  double shift = 0.1;
};
[[nodiscard]] Eigen::Matrix2Xd disturbed(const Eigen::Matrix2Xd& points,
                                         const Disturbance& disturbance, std::uint64_t seed);

struct SearchOptions {
  double smallest = 0.15;  // width of the object, share of the image's smaller side
  double largest = 0.9;
  double scale_step = 1.2;
  double place_step = 0.12;  // share of the width
  int best = 5;              // candidates that are fitted at the coarsest level

  [[nodiscard]] OptionFields fields() {
    return {{"scale_step", scale_step, range(1.02, 4)},
            {"smallest", smallest, above(0, 4)},
            {"largest", largest, above(0, 4)},
            {"place_step", place_step, range(0.02, 1)},
            {"best", best, range(1, 100)}};
  }
  void check() const;
};
// Exhaustive search of the image for the upright mean shape: computes the coarsest texture's error
// at all positions and sizes, then fits from the best of them. Returns the start with the smallest
// error; empty if all fits are lost.
[[nodiscard]] std::optional<Eigen::Matrix2Xd> search_start(const Fitter& fitter,
                                                           const cv::Mat& image,
                                                           const SearchOptions& options,
                                                           FitWorkspace& workspace);

}  // namespace tarsier::face::appearance
