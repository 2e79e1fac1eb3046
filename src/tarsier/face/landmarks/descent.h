// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/gradient_features.h"
#include "tarsier/face/landmarks/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Supervised descent (Xiong and De la Torre, "Supervised descent method and its applications to
// face alignment", CVPR 2013): a few linear regressions, each from descriptors at the current
// points to the step towards the true ones.
namespace tarsier::face::landmarks {

struct DescentOptions {
  std::vector<FeatureScale> stages = {{24, 0.36}, {32, 0.25}, {40, 0.18}, {48, 0.14}};
  int components = 32;  // numbers kept of a descriptor, by PCA over all points
  // Regularisation, share of the mean squared feature times the samples. Much of it and several
  // stages beat little of it (as shrinkage does in boosting).
  double ridge = 2;
  int folds = 4;  // parts of the faces for cross-fitting (see train_descent)
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"components", components, range(4, kDescriptor)},
            {"ridge", ridge, above(0)},
            {"folds", folds, range(2, 20)}};
  }
  void check() const;  // the scales too
};

struct Descent {
  Eigen::Matrix2Xd mean;  // 2 x n: centred, size 1 (units)
  struct Stage {
    FeatureScale scale;
    Eigen::VectorXf center;      // kDescriptor, mean descriptor
    Eigen::MatrixXf components;  // kDescriptor x d
    Eigen::MatrixXf weights;     // 2n x (n d): features of point 0, point 1, ..
    Eigen::VectorXf bias;        // 2n, units
  };
  std::vector<Stage> stages;
  [[nodiscard]] int points() const { return static_cast<int>(mean.cols()); }
  void check() const;
};

// What cross-fitting tells.
struct DescentReport {
  std::vector<double> errors;  // after each stage: RMS distance of a point from its true place on
                               // faces left out, units
  // Where the set's points lie to the right of the places that a mirror-symmetric model gives them,
  // px of the images, mean over the faces: not 0 where pixels were counted from 1, or by habit of
  // the annotators. Only known where mirrored faces take part, else 0.
  double to_the_right = 0;
};

// One stage: upright = similarity that takes the current points to the mean; features f of all
// points there; the new points are upright^-1 (upright x + W f + b).
//
// Faces are divided into `folds` parts. In each stage the starts of a part move by a regression
// learned from the other parts, so that the next stage learns from errors as they are on faces
// never seen; the regression that is kept learns from all. The same result for any number of
// threads.
[[nodiscard]] Descent train_descent(const std::vector<TrainingFace>& faces,
                                    const std::vector<Start>& starts, const DescentOptions& options,
                                    Progress& progress, const std::stop_token& stop,
                                    DescentReport* report = nullptr);

struct DescentWorkspace {
  FeatureWorkspace features;
  cv::Mat reduced;
  std::vector<float> descriptors;
  Eigen::VectorXf compressed;
  Eigen::VectorXf step;
};

// The fit from `start` (px of `gray`, CV_8UC1). `compressed` of the workspace holds the last
// stage's features afterwards.
[[nodiscard]] Eigen::Matrix2Xd fit_descent(const Descent& model, const cv::Mat& gray,
                                           const Eigen::Matrix2Xd& start,
                                           DescentWorkspace& workspace);

// Features of one stage at `points`: n * d numbers.
void stage_features(const Descent::Stage& stage, const Eigen::Matrix2Xd& mean, const cv::Mat& gray,
                    const Eigen::Matrix2Xd& points, DescentWorkspace& workspace, float* out);

// Sets the stage's scale, mean descriptor and `components` directions of most variance, of all
// points of the shapes together. images[i] shows points[i].
void compress_descriptors(Descent::Stage& stage, const FeatureScale& scale, int components,
                          const Eigen::Matrix2Xd& mean, const std::vector<const cv::Mat*>& images,
                          const std::vector<Eigen::Matrix2Xd>& points);

// The image around a shape of size `size_px`, reduced so that its unit is at most 1.5 times
// `px_per_unit`; image_from_reduced: x = scale * x_reduced + offset.
struct Reduced {
  cv::Mat gray;
  double scale = 1;
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();
};
[[nodiscard]] Reduced reduce_around(const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                                    double px_per_unit);

[[nodiscard]] nlohmann::json to_json(const Descent& model);
[[nodiscard]] Descent descent_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::landmarks
