// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/start.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::face::appearance {

// Detects the object in an image: its box, if found. Called from one thread at a time.
using Detect = std::function<std::optional<cv::Rect2d>(const cv::Mat& image)>;

// Mean distance of the points from the ground truth, divided by the distance of two ground-truth
// points (`eyes`). Throws std::invalid_argument if this distance is 0.
[[nodiscard]] double point_error(const Eigen::Matrix2Xd& points, const Eigen::Matrix2Xd& truth,
                                 const std::array<int, 2>& eyes);

// Sets model.shape_in_box from a detector's boxes on training images; returns how many were used. A
// box counts if it contains the points' centre. Without any box, model.shape_in_box is not changed.
int set_shape_in_box(AppearanceModel& model, const std::vector<TrainingImage>& images,
                     const Detect& detect);

// The two points of the mean shape that are farthest apart: a unit of length if the eyes are
// unknown.
[[nodiscard]] std::array<int, 2> farthest_points(const shape::ShapeModel& model);

// model.lost_error for a model of these images. A second model is trained on two thirds of the
// people in them (of the images, if they show fewer than three people). It is fitted to the rest,
// from starts near the true points and from starts far away. 0 if there are fewer than 6 images.
// The result does not depend on the number of threads.
[[nodiscard]] double learn_lost_error(const std::vector<TrainingImage>& images,
                                      const std::vector<int>& mirror,
                                      const AppearanceOptions& options, std::uint64_t seed,
                                      Progress& progress, const std::stop_token& stop);

// Frequency of convergence from random starts around the true points, for increasing disturbance.
struct ConvergencePoint {
  double disturbance = 0;  // share of options.max_disturbance
  int tries = 0;
  int converged = 0;      // point error below `limit`
  double mean_error = 0;  // of these, share of the eye distance
};
struct ConvergenceOptions {
  Disturbance max_disturbance{0.1, 10, 0.1};
  std::vector<double> steps{0, 0.25, 0.5, 0.75, 1, 1.5, 2};
  int tries = 5;  // per image and step
  double limit = 0.05;
  std::array<int, 2> eyes{-1, -1};
  std::uint64_t seed = 1;
  void check(int points) const;
};
// The result does not depend on the number of threads.
[[nodiscard]] std::vector<ConvergencePoint> study_convergence(
    const Fitter& fitter, const std::vector<TrainingImage>& images,
    const ConvergenceOptions& options, Progress& progress, const std::stop_token& stop);
struct ConvergenceCurve {
  std::string name;
  std::vector<ConvergencePoint> points;
};
[[nodiscard]] cv::Mat draw_convergence(const std::vector<ConvergenceCurve>& curves,
                                       const ConvergenceOptions& options,
                                       cv::Size size = {800, 500});

}  // namespace tarsier::face::appearance
