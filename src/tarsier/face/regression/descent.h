// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/regression/gradient_features.h"
#include "tarsier/face/regression/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Supervised descent (Xiong and De la Torre, "Supervised descent method and its applications to
// face alignment", CVPR 2013): a few linear regressions, each from the descriptors at the current
// points to the step towards the true points.
namespace tarsier::face::regression {

struct DescentOptions {
  std::vector<FeatureScale> stages = {{24, 0.36}, {32, 0.25}, {40, 0.18}, {48, 0.14}};
  int components = 32;  // components of a descriptor, by PCA over all points
  // Regularisation, relative to the mean squared feature times the samples. Strong regularisation
  // with several stages is better than weak regularisation (like shrinkage in boosting).
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

// Results of cross-fitting.
struct DescentReport {
  // After each stage: RMS distance of a point from its true position on held-out faces, units.
  std::vector<double> errors;
  // Horizontal offset of the set's points from those of a mirror-symmetric model, px of the images,
  // positive to the right; mean over the faces. Not 0 if pixels were counted from 1 or the
  // annotators were biased. Needs mirrored faces; otherwise 0.
  double to_the_right = 0;
};

// One stage: upright = similarity from the current points to the mean; f = features of all points
// in that frame; the new points are upright^-1 (upright x + W f + b).
//
// Faces are divided into `folds` parts. In each stage, the starts of a part are moved by a
// regression that was trained on the other parts. The next stage is therefore trained on the errors
// of held-out faces. The stored regression is trained on all faces. The result does not depend on
// the number of threads.
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

// The fit from `start` (px of `gray`, CV_8UC1). Afterwards, `compressed` of the workspace holds the
// last stage's features.
[[nodiscard]] Eigen::Matrix2Xd fit_descent(const Descent& model, const cv::Mat& gray,
                                           const Eigen::Matrix2Xd& start,
                                           DescentWorkspace& workspace);

// Features of one stage at `points`: n * d numbers.
void stage_features(const Descent::Stage& stage, const Eigen::Matrix2Xd& mean, const cv::Mat& gray,
                    const Eigen::Matrix2Xd& points, DescentWorkspace& workspace, float* out);

// Sets the stage's scale, mean descriptor and the `components` directions of greatest variance,
// over all points of the shapes together. images[i] shows points[i].
void compress_descriptors(Descent::Stage& stage, const FeatureScale& scale, int components,
                          const Eigen::Matrix2Xd& mean, const std::vector<const cv::Mat*>& images,
                          const std::vector<Eigen::Matrix2Xd>& points);

// The image around a shape, reduced so that the shape's unit is at most 1.5 times `px_per_unit`;
// image_from_reduced: x = scale * x_reduced + offset.
struct Reduced {
  cv::Mat gray;
  double scale = 1;
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();
};
[[nodiscard]] Reduced reduce_around(const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                                    double px_per_unit);

[[nodiscard]] nlohmann::json to_json(const Descent& model);
[[nodiscard]] Descent descent_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::regression
