// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/dense/cloud.h"
#include "tarsier/sfm/dense/surface_truth.h"
#include "tarsier/sfm/dense/workspace.h"

#include <opencv2/core/mat.hpp>

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// Accuracy of depth maps and a cloud, compared with ground truth.
struct DenseScores {
  struct Depth {
    std::string name;
    double median = 0;        // relative error of the depths that both have
    double within_tenth = 0;  // share of these with an error of at most 0.1 %
    double within_half = 0;   // .. 0.5 %
    double within_one = 0;    // .. 1 %
    double known = 0;         // share of the true depths that are known
  };
  std::vector<Depth> images;
  double depth_median = 0;  // over all pixels of all images
  double extent = 0;  // world units of the truth: diagonal of the bounding box of the true surface
  std::vector<ThresholdScore> cloud;  // empty without a cloud
};
// {"images": [..], "depth_median", "extent", "cloud": [{"threshold", "accuracy", "completeness", "f1"}]}
[[nodiscard]] nlohmann::ordered_json to_json(const DenseScores& scores);

// Estimates truth_from_model from common images: the rotation from the orientations of the cameras
// (Kabsch), scale and translation from their centres. Throws InputError where fewer than two images
// are common, or their centres coincide.
[[nodiscard]] geometry::Sim3 align_workspaces(const Workspace& truth, const Workspace& model);

// `show` may be empty. It receives the name of each image and an image of its errors: black
// unknown, from blue (none) to red (1 % and more). The true surface consists of the true depth maps
// where at least two images see it, thinned to a point per 0.1 % of the extent. The cloud is
// fused.ply of `model`, if it exists. Throws InputError, Interrupted.
[[nodiscard]] DenseScores evaluate_dense(
    const Workspace& truth, const Workspace& model,
    const std::function<void(const std::string&, const cv::Mat&)>& show, Progress& progress,
    const std::stop_token& stop);

}  // namespace tarsier::sfm
