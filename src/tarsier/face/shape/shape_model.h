// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/similarity.h"

#include <Eigen/Core>

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::face::shape {

struct ShapeModelOptions {
  double variance = 0.95;  // share of the variance that the modes keep
  int max_modes = 20;
  int iterations = 20;  // of Procrustes alignment
  bool mirror = false;  // also train on mirrored shapes; needs the symmetry

  [[nodiscard]] OptionFields fields() {
    return {{"variance", variance, above(0, 1), "--variance",
             "share of the variance kept by the shape modes"},
            {"max_modes", max_modes, range(1, 1000), "--modes", "maximum number of shape modes"},
            {"iterations", iterations, range(1, 1000)}};
  }
  void check() const { check_fields(*this); }
};

// A linear point distribution model (Cootes et al., "Active shape models", CVIU 1995):
//   shape = T(mean + modes b), T a similarity.
// The mean is centred on 0, has RMS radius 1 (sqrt of the mean squared distance of its points from
// 0) and the mean orientation of the training shapes. Shapes as vectors: x0 y0 x1 y1 ...
struct ShapeModel {
  Eigen::Matrix2Xd mean;  // 2 x n
  // 2n x m, orthonormal, orthogonal to the four directions of the similarity at the mean; m may be
  // 0.
  Eigen::MatrixXd modes;
  Eigen::VectorXd deviation;  // m, standard deviation of b, falling
  double variance_kept = 1;   // share, [0, 1]
  int trained_on = 0;         // shapes
  std::vector<int> mirror;    // as in LandmarkSet
  std::vector<std::array<int, 2>> connections;

  [[nodiscard]] int points() const { return static_cast<int>(mean.cols()); }
  [[nodiscard]] int mode_count() const { return static_cast<int>(modes.cols()); }
  void check() const;  // throws std::invalid_argument
};

// Aligns the shapes (2 x n each; those with NaN are skipped) by generalised Procrustes analysis
// (Gower 1975; each shape to the mean with scale, the mean renormalised, until convergence).
// Removes the similarity directions and applies PCA to the residuals. Throws std::invalid_argument
// for fewer than 2 complete shapes or shapes without extent.
[[nodiscard]] ShapeModel train_shape_model(const std::vector<Eigen::Matrix2Xd>& shapes,
                                           const ShapeModelOptions& options = {});
// Trains on a set, with mirrored shapes if requested; copies its mirror and connections.
[[nodiscard]] ShapeModel train_shape_model(const LandmarkSet& set,
                                           const ShapeModelOptions& options = {});

// Parameters of a shape.
struct ShapeFit {
  Similarity2d image_from_model;
  Eigen::VectorXd b;
};

// Limits |b_i| to sigmas * deviation_i, in place. Returns whether any value was out of range.
bool clamp(const ShapeModel& model, Eigen::VectorXd& b, double sigmas = 3);

// The parameters that fit `points` in weighted least squares (weights as in fit_similarity; NaN
// points are ignored): in closed form for equal weights, otherwise by Gauss-Newton to convergence.
// If sigmas > 0, |b_i| <= sigmas * deviation_i, and the other parameters are optimal under these
// limits. If noise > 0 (standard deviation of a coordinate of weight 1, in the mean's frame), b is
// regularised by its variance: minimises sum w |residual|^2 / noise^2 + b_i^2 / deviation_i^2.
[[nodiscard]] ShapeFit fit_shape(const ShapeModel& model, const Eigen::Matrix2Xd& points,
                                 const Eigen::VectorXd& weights = {}, double sigmas = 3,
                                 double noise = 0);

[[nodiscard]] Eigen::Matrix2Xd shape_of(const ShapeModel& model, const ShapeFit& fit);
[[nodiscard]] Eigen::Matrix2Xd shape_of(const ShapeModel& model, const Eigen::VectorXd& b);

// Orthonormal basis of similarity and deformation together, 2n x (4 + m): the first four columns
// span scale-rotation and translation of the mean, the others are the modes. In the model's frame,
// a nearly upright shape is basis * c (Saragih et al., "Deformable model fitting by regularized
// landmark mean-shift", IJCV 2011, linearised).
[[nodiscard]] Eigen::MatrixXd combined_basis(const ShapeModel& model);

// For model files; from_json throws ModelError(path).
[[nodiscard]] nlohmann::json to_json(const ShapeModel& model);
[[nodiscard]] ShapeModel shape_model_from_json(const nlohmann::json& value,
                                               const std::string& path);
// Files of type "shape-model".
void write_shape_model(const std::string& path, const ShapeModel& model,
                       const nlohmann::json& provenance);
[[nodiscard]] ShapeModel read_shape_model(const std::string& path);

}  // namespace tarsier::face::shape
