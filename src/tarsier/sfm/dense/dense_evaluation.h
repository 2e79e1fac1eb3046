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

// How good depth maps and a cloud are, where the truth is known.
struct DenseScores {
  struct Depth {
    std::string name;
    double median = 0;        // relative error of the depths that both know
    double within_tenth = 0;  // share of these with an error of at most 0.1 %,
    double within_half = 0;   // 0.5 %
    double within_one = 0;    // and 1 %
    double known = 0;         // share of the true depths that are known
  };
  std::vector<Depth> images;
  double depth_median = 0;  // of all pixels of all images
  double extent = 0;        // world units of the truth: diagonal of the box around the true surface
  std::vector<ThresholdScore> cloud;  // empty without a cloud
};
// {"images": [..], "depth_median", "extent", "cloud": [{"threshold", "accuracy", "completeness", "f1"}]}
[[nodiscard]] nlohmann::ordered_json to_json(const DenseScores& scores);

// truth_from_model by the images of both: the rotation between the cameras' orientations (Kabsch), scale and
// place by their centres. Throws InputError where fewer than two names, or one place, are in both.
[[nodiscard]] geometry::Sim3 align_workspaces(const Workspace& truth, const Workspace& model);

// `show`, which may be empty, takes the name of each image and an image of its errors: black
// unknown, from blue (none) to red (1 % and more). The true surface is the depth maps of the truth
// where two images at least see it, thinned to a point for each 0.1 % of the extent. The
// cloud is fused.ply of `model`, if it is there. Throws InputError, Interrupted.
[[nodiscard]] DenseScores evaluate_dense(
    const Workspace& truth, const Workspace& model,
    const std::function<void(const std::string&, const cv::Mat&)>& show, Progress& progress,
    const std::stop_token& stop);

}  // namespace tarsier::sfm
