// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/rng.h"
#include "tarsier/plate/classic/features.h"
#include "tarsier/plate/classic/linear.h"

#include <opencv2/core/mat.hpp>

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::plate {

// Candidates of 144x33 px, CV_8UC1, equalised. Labels: 1 (plate) or -1.
struct PlateSet {
  std::vector<cv::Mat> candidates;
  std::vector<int> labels;
};

// SVM.xml (`TrainingData` of 144*33 columns and `classes` of 1 and 0), or a folder with plate/ and
// no-plate/. Throws InputError.
[[nodiscard]] PlateSet read_plate_set(const std::string& path);

struct PlateSvmOptions {
  PlateFeatures features = PlateFeatures::kPixels;
  double cost = 0.1;
  int iterations = 1000;
  int components = 40;  // maximum, for kPca

  [[nodiscard]] OptionFields fields() {
    return {{"cost", cost, above(0, 1e6), "--cost", "cost parameter C of the SVM"},
            {"iterations", iterations, range(1, 1'000'000)},
            {"components", components, range(1, 500)}};
  }
  void check() const { check_fields(*this); }
};

// Classifies a candidate as plate or no plate.
struct PlateSvm {
  PlateFeatures features = PlateFeatures::kPixels;
  std::vector<float> mean;  // for kPca
  cv::Mat basis;            // components x pixels, CV_32F, for kPca
  LinearModel model;
  PlattScaling platt;

  [[nodiscard]] double margin(const cv::Mat& candidate) const;
};

// Trains the SVM. The probability is fitted to margins of held-out examples (5-fold
// cross-validation).
[[nodiscard]] PlateSvm train_plate_svm(const PlateSet& set, const PlateSvmOptions& options,
                                       Rng rng);

// Error rate by 5-fold cross-validation.
[[nodiscard]] double cross_validated_error(const PlateSet& set, const PlateSvmOptions& options,
                                           Rng rng);

[[nodiscard]] PlateSvm read_plate_svm(const std::string& path);  // ModelError
void write_plate_svm(const std::string& path, const PlateSvm& svm,
                     const nlohmann::json& provenance);

}  // namespace tarsier::plate
