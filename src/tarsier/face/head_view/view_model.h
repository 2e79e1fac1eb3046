// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/angle_sigma.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head_view/head_view.h"

#include <Eigen/Core>

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

// Where a head looks, learnt from how heads look: corrects the direction of a pose that landmarks
// gave. Landmarks slip over faces that are turned far: the tilt of such heads comes out at a third
// of what it is (docs/results.md).
//
// Kernel ridge regression (Saunders, Gammerman and Vovk, ICML 1998). A view becomes the point
//   f = [B^T ([gradients ; offsets] - mean) ; (pitch, yaw, roll) / angle_scale]
// and the correction, in degrees, is
//   (pitch, yaw) - (pitch, yaw) of the rough pose = sum_i exp(-gamma |f - f_i|^2) weights_i.
// It is nothing for views unlike all that were learnt.
namespace tarsier::face::head_view {

struct ViewModel {
  Eigen::VectorXf mean;         // kGradients + 2n, n: landmarks, 0 where offsets are not used
  Eigen::MatrixXf basis;        // (kGradients + 2n) x k, scaled as f needs it
  Eigen::Vector3f angle_scale;  // degrees, > 0
  Eigen::MatrixXf centres;      // (k + 3) x n, the f_i
  Eigen::MatrixXf weights;      // 2 x n, degrees: of pitch and yaw
  double gamma = 0.3;           // > 0
  double max_deg = 25;          // corrections are cut off here, (0, 90]
  int trained_on = 0;           // views

  [[nodiscard]] int landmarks() const { return static_cast<int>(mean.size() - kGradients) / 2; }
  // Throws std::invalid_argument for a view of another number of offsets.
  [[nodiscard]] Eigen::VectorXf point_of(const HeadView& view) const;
  void check() const;  // throws std::invalid_argument
};

// Where the head of a view looks.
struct ViewAnswer {
  Direction direction;
  // d(pitch, yaw) of the direction by the view's rough (pitch, yaw), gradients and offsets as they
  // are: how errors of the points go on.
  Eigen::Matrix2d slope = Eigen::Matrix2d::Identity();
};
[[nodiscard]] ViewAnswer looks_to(const ViewModel& model, const HeadView& view);

// Errors of the angles after a correction by head-view.json. With the factors 71 to 73 % of the errors
// of 1307 drawn heads and annotated faces that it had not learnt from are within one sigma, 93 to
// 97 % within two. The floors then cover 68 % of the errors of the seven people of Pointing'04, each left out of the
// view in turn, against the names of the images (docs/pose.md, Uncertainty). These do not say how
// heads roll: that has no floor.
inline constexpr head::AngleCalibration kViewSigma{{1.7, 6.6}, {1.7, 9.7}, {2.4, 0}};

// The pose with that direction: the turn about it, the place and the shape are those which explain
// the points best (see head::HeadPoser::pose_towards). `pose` and `identity` (may be null, is not
// changed) as they came from the poser for these points. Nothing where the head cannot be seen or
// the points do not fit.
[[nodiscard]] std::optional<head::HeadPose> refined_pose(
    const ViewModel& model, const head::HeadPoser& poser, const Eigen::Matrix2Xd& points,
    const cv::Mat& gray, const geometry::Camera& camera, const head::HeadPose& pose,
    const head::HeadIdentity* identity, const Eigen::VectorXd& sigma_px = {});

// The same with an answer that is there already. The covariance of the rotation is that of `pose`,
// as its poser gave it, in the view's yaw, pitch and roll, carried on by the slope; then calibrated
// by kViewSigma.
[[nodiscard]] std::optional<head::HeadPose> refined_pose(
    const ViewAnswer& answer, const HeadView& view, const head::HeadPoser& poser,
    const Eigen::Matrix2Xd& points, const geometry::Camera& camera, const head::HeadPose& pose,
    const head::HeadIdentity* identity, const Eigen::VectorXd& sigma_px = {});

// Files of type "head-view", version 3. Reading throws ModelError(path).
void write_view_model(const std::string& path, const ViewModel& model,
                      const nlohmann::json& provenance);
[[nodiscard]] ViewModel read_view_model(const std::string& path);

}  // namespace tarsier::face::head_view
