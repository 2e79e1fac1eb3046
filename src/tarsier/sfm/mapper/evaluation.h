// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/scene/model.h"

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::sfm {

// True poses: camera_from_world by image name.
using PoseTruth = std::map<std::string, geometry::Rigid3>;

// Reads JSON lines {"name", "R": 9 numbers row by row, world to camera, "C": 3 numbers or "t"}, or
// a folder with a COLMAP text model. Throws InputError with the line.
[[nodiscard]] PoseTruth read_pose_truth(const std::string& path);

struct PoseScores {
  int total = 0;       // images of the ground truth
  int registered = 0;  // of these, in the model
  // Errors of the centres after the best similarity (Umeyama); units of the ground truth.
  double center_mean = 0;
  double center_median = 0;
  double center_max = 0;
  std::string center_worst;      // name of the image with center_max
  double extent = 0;             // diagonal of the bounding box of the true centres
  double rotation_mean_deg = 0;  // after the best rotation
  // Area under the recall curve of max(error of the relative rotation, error of the translation
  // direction) over all pairs, in percent, up to 0.5, 1, 3, 5 degrees. A missing image fails all
  // its pairs.
  std::map<double, double> auc;
};
// Throws InputError where fewer than three images are in both.
[[nodiscard]] PoseScores evaluate_poses(const Model& model, const PoseTruth& truth,
                                        const std::string& name);
[[nodiscard]] nlohmann::ordered_json scores_json(const PoseScores& scores, const Model& model);

}  // namespace tarsier::sfm
