// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/training_face.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::face::regression {

// Learned quality of a fit: a linear regression from the descriptors at the points. The target in
// training is 1 for an error of at most 2 % of the shape's size, and 0 from 20 % on.
struct Quality {
  Eigen::Matrix2Xd mean;
  Descent::Stage stage;  // its weights are 1 x (n d)
};

struct QualityOptions {
  FeatureScale scale{30, 0.22};
  int components = 16;  // components of a descriptor
  double ridge = 0.3;   // relative to the mean squared feature times the samples

  [[nodiscard]] OptionFields fields() {
    return {{"components", components, range(1, kDescriptor)}, {"ridge", ridge, above(0)}};
  }
  void check() const {
    check_fields(*this);
    scale.check();
  }
};

// A fit with known error.
struct RatedFit {
  int face = 0;
  Eigen::Matrix2Xd points;  // px of the face's image
};

// Throws Interrupted, std::invalid_argument.
[[nodiscard]] Quality train_quality(const std::vector<TrainingFace>& faces,
                                    const std::vector<RatedFit>& fits,
                                    const QualityOptions& options, Progress& progress,
                                    const std::stop_token& stop);

// 0..1.
[[nodiscard]] double quality_of(const Quality& model, const cv::Mat& gray,
                                const Eigen::Matrix2Xd& points, DescentWorkspace& workspace);

[[nodiscard]] nlohmann::json to_json(const Quality& model);
[[nodiscard]] Quality quality_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::regression
