// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/angle_sigma.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head_view/head_view.h"

#include <Eigen/Core>

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

// Corrects the direction of a pose from landmarks by the appearance of the whole head. Landmarks
// are inaccurate on faces that are turned far: the estimated tilt of such heads is a third of the
// true one (docs/results.md).
//
// Kernel ridge regression (Saunders, Gammerman and Vovk, ICML 1998). A view is converted to the
// vector
//   f = [B^T ([gradients ; offsets] - mean) ; (pitch, yaw, roll) / angle_scale]
// and the correction, in degrees, is
//   (pitch, yaw) - (pitch, yaw) of the approximate pose = sum_i exp(-gamma |f - f_i|^2) weights_i.
// It is zero for views that differ from all training views.
namespace tarsier::face::head_view {

struct ViewModel {
  Eigen::VectorXf mean;         // kGradients + 2n, n: landmarks, 0 if offsets are not used
  Eigen::MatrixXf basis;        // (kGradients + 2n) x k, scaled for f
  Eigen::Vector3f angle_scale;  // degrees, > 0
  Eigen::MatrixXf centres;      // (k + 3) x n, the f_i
  Eigen::MatrixXf weights;      // 2 x n, degrees: of pitch and yaw
  double gamma = 0.3;           // > 0
  double max_deg = 25;          // limit of corrections, (0, 90]
  int trained_on = 0;           // views

  [[nodiscard]] int landmarks() const { return static_cast<int>(mean.size() - kGradients) / 2; }
  // Throws std::invalid_argument for a view with another number of offsets.
  [[nodiscard]] Eigen::VectorXf point_of(const HeadView& view) const;
  void check() const;  // throws std::invalid_argument
};

// The corrected direction of a view's head.
struct CorrectedDirection {
  Direction direction;
  // d(pitch, yaw) of the direction by the view's approximate (pitch, yaw), with constant gradients
  // and offsets: the propagation of errors of the points.
  Eigen::Matrix2d jacobian = Eigen::Matrix2d::Identity();
};
[[nodiscard]] CorrectedDirection correct_direction(const ViewModel& model, const HeadView& view);

// Errors of the angles after a correction by head-view.json. With these factors, 71 to 73 % of the
// errors on 1307 held-out synthetic heads and annotated faces are within one sigma, 93 to 97 %
// within two. The floors cover 68 % of the errors on the seven people of Pointing'04 against the
// angles in the file names, each person held out of the view model in turn (docs/pose.md,
// Uncertainty). These names do not contain the roll, so it has no floor.
inline constexpr head::AngleCalibration kViewSigma{{1.7, 6.6}, {1.7, 9.7}, {2.4, 0}};

// The pose with the corrected direction. The rotation about it, the translation and the shape are
// those that explain the points best (see head::HeadPoseEstimator::pose_towards). `pose` and
// `identity` (may be null, is not changed) are those of the estimator for these points. Empty if
// the head is not visible or the points do not fit.
[[nodiscard]] std::optional<head::HeadPose> refined_pose(
    const ViewModel& model, const head::HeadPoseEstimator& estimator,
    const Eigen::Matrix2Xd& points, const cv::Mat& gray, const geometry::Camera& camera,
    const head::HeadPose& pose, const head::HeadIdentity* identity,
    const Eigen::VectorXd& sigma_px = {});

// The same with a known correction. The covariance of the rotation is that of `pose` from its
// estimator, in the view's yaw, pitch and roll, propagated by the jacobian and calibrated by
// kViewSigma.
[[nodiscard]] std::optional<head::HeadPose> refined_pose(
    const CorrectedDirection& corrected, const HeadView& view,
    const head::HeadPoseEstimator& estimator, const Eigen::Matrix2Xd& points,
    const geometry::Camera& camera, const head::HeadPose& pose, const head::HeadIdentity* identity,
    const Eigen::VectorXd& sigma_px = {});

// Files of type "head-view", version 3. Reading throws ModelError(path).
void write_view_model(const std::string& path, const ViewModel& model,
                      const nlohmann::json& provenance);
[[nodiscard]] ViewModel read_view_model(const std::string& path);

}  // namespace tarsier::face::head_view
