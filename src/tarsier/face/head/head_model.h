// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::face::head {

// 3D landmarks of a head and their deformation:
//   shape = mean + modes b,  b_k has mean 0 and standard deviation deviation_k.
// Frame: mm, the origin midway between the outer eye corners, x to image right, y down, z forward
// (away from the camera) when the head looks straight into the camera. The nose has z < 0, and x=0
// is the plane of symmetry. Shapes as vectors: x0 y0 z0 x1 ...
struct HeadModel {
  Eigen::Matrix3Xd mean;      // 3 x n, symmetric
  Eigen::MatrixXd modes;      // 3n x m, orthonormal, each symmetric; m may be 0
  Eigen::VectorXd deviation;  // m, mm, falling
  // n, mm, 1e-6..1e6: standard deviation of an annotated point's coordinate around what the modes
  // can explain.
  Eigen::VectorXd noise;
  std::vector<int> mirror;                      // mirror[i]: index of point i in the mirrored head
  std::array<int, 2> outer_eyes{-1, -1};        // outer corners: image left, image right
  std::vector<int> landmark;                    // number of each point in its markup, n
  std::vector<std::array<int, 2>> connections;  // lines to draw; indices of model points
  // Model points of the face's contour, which slide over the head as it turns; may be empty.
  std::vector<int> outline;
  int trained_on = 0;  // faces

  [[nodiscard]] int points() const { return static_cast<int>(mean.cols()); }
  [[nodiscard]] int mode_count() const { return static_cast<int>(modes.cols()); }
  void check() const;  // throws std::invalid_argument
};

// mean + modes b as 3 x n; b may be shorter than the number of modes (the rest is 0).
[[nodiscard]] Eigen::Matrix3Xd shape_of(const HeadModel& model, const Eigen::VectorXd& b);

// The model reduced to some of its points, in this order: indices of model points, each once, at
// least 4. It describes the same shapes, but its modes are orthonormalised, so b has another
// meaning. `mirror` is empty if only one point of a pair is included; outer_eyes is -1 if one is
// missing.
[[nodiscard]] HeadModel select_points(const HeadModel& model, const std::vector<int>& points);

// The landmark of another markup for each model point. Text file: one pair "model_point landmark"
// per line, both counted from 0; '#' begins a comment. Throws InputError with path and line: not
// two integers, out of range, a point or a landmark twice, fewer than four pairs.
struct LandmarkMapping {
  std::vector<int> model_points;
  std::vector<int> landmarks;
};
[[nodiscard]] LandmarkMapping read_landmark_mapping(const std::string& path, int model_points,
                                                    int landmarks);

// The mapping in the model itself (model.landmark).
[[nodiscard]] LandmarkMapping own_mapping(const HeadModel& model);

// For model files; from_json throws ModelError(path).
[[nodiscard]] nlohmann::json to_json(const HeadModel& model);
[[nodiscard]] HeadModel head_model_from_json(const nlohmann::json& value, const std::string& path);
// Files of type "head-model", version 1.
void write_head_model(const std::string& path, const HeadModel& model,
                      const nlohmann::json& provenance);
[[nodiscard]] HeadModel read_head_model(const std::string& path);

}  // namespace tarsier::face::head
