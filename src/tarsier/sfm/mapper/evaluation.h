// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/scene/model.h"

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::sfm {

// What is known of where images were taken: camera_from_world by name.
using PoseTruth = std::map<std::string, geometry::Rigid3>;

// Lines of JSON {"name", "R": 9 numbers row by row, world to camera, "C": 3 numbers or "t"}, or a
// folder with a COLMAP text model. Throws InputError with the line.
[[nodiscard]] PoseTruth read_pose_truth(const std::string& path);

struct PoseScores {
  int total = 0;       // images of the truth
  int registered = 0;  // of these in the model
  // Centres after the similarity that fits them best (Umeyama); units of the truth.
  double center_mean = 0;
  double center_median = 0;
  double center_max = 0;
  std::string center_worst;      // name
  double extent = 0;             // diagonal of the box around the true centres
  double rotation_mean_deg = 0;  // after the rotation that fits them best
  // Area under the recall curve of max(relative rotation, direction of translation) over all pairs,
  // in percent, up to 0.5, 1, 3, 5 degrees. An image that is missing fails all its pairs.
  std::map<double, double> auc;
};
// Throws InputError where fewer than three images are in both.
[[nodiscard]] PoseScores evaluate_poses(const Model& model, const PoseTruth& truth,
                                        const std::string& name);
[[nodiscard]] nlohmann::ordered_json scores_json(const PoseScores& scores, const Model& model);

}  // namespace tarsier::sfm
