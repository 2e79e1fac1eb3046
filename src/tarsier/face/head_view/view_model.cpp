// SPDX-License-Identifier: MIT
#include "tarsier/face/head_view/view_model.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::head_view {

using Eigen::Index;
using Eigen::VectorXf;

void ViewModel::check() const {
  TARSIER_REQUIRE(mean.size() >= kGradients && (mean.size() - kGradients) % 2 == 0,
                  "a mean of {} numbers", mean.size());
  TARSIER_REQUIRE(basis.rows() == mean.size() && basis.cols() >= 1 && basis.cols() <= mean.size(),
                  "a basis of {} x {}", basis.rows(), basis.cols());
  TARSIER_REQUIRE(centres.rows() == basis.cols() + 3 && centres.cols() >= 1, "centres of {} x {}",
                  centres.rows(), centres.cols());
  TARSIER_REQUIRE(weights.rows() == 2 && weights.cols() == centres.cols(), "weights of {} x {}",
                  weights.rows(), weights.cols());
  TARSIER_REQUIRE(angle_scale.minCoeff() > 0, "a scale of angles that is not positive");
  TARSIER_REQUIRE(gamma > 0 && gamma <= 1e6, "gamma {}", gamma);
  TARSIER_REQUIRE(max_deg > 0 && max_deg <= 90, "corrections up to {} degrees", max_deg);
  TARSIER_REQUIRE(mean.allFinite() && basis.allFinite() && centres.allFinite() &&
                      weights.allFinite() && angle_scale.allFinite(),
                  "numbers that are not finite");
}

VectorXf ViewModel::point_of(const HeadView& view) const {
  TARSIER_REQUIRE(
      view.gradients.size() == kGradients && view.offsets.size() == mean.size() - kGradients,
      "a view of {} gradients and {} offsets", view.gradients.size(), view.offsets.size());
  const Index k = basis.cols();
  VectorXf appearance(mean.size());
  appearance << view.gradients, view.offsets;
  appearance -= mean;
  VectorXf point(k + 3);
  point.head(k).noalias() = basis.transpose() * appearance;
  const Eigen::Vector3f angles(static_cast<float>(view.angles.pitch_deg),
                               static_cast<float>(view.angles.yaw_deg),
                               static_cast<float>(view.angles.roll_deg));
  point.tail<3>() = angles.cwiseQuotient(angle_scale);
  return point;
}

namespace {

// The covariance of a rotation after the correction of its direction, in the camera's frame, rad^2.
Eigen::Matrix3d corrected_covariance(const CorrectedDirection& corrected, const HeadView& view,
                                     const Eigen::Matrix3d& rough) {
  const Eigen::Matrix3d& r = view.camera_from_view;
  Eigen::Matrix3d jacobian = Eigen::Matrix3d::Identity();  // of (yaw, pitch, roll)
  jacobian(0, 0) = corrected.jacobian(1, 1);
  jacobian(0, 1) = corrected.jacobian(1, 0);
  jacobian(1, 0) = corrected.jacobian(0, 1);
  jacobian(1, 1) = corrected.jacobian(0, 0);
  const Eigen::Matrix3d angles = jacobian *
                                 head::angle_covariance(view.angles, r.transpose() * rough * r) *
                                 jacobian.transpose();
  return r *
         head::rotation_covariance(
             {corrected.direction.yaw_deg, corrected.direction.pitch_deg, view.angles.roll_deg},
             angles) *
         r.transpose();
}

}  // namespace

CorrectedDirection correct_direction(const ViewModel& model, const HeadView& view) {
  const VectorXf point = model.point_of(view);
  const VectorXf squares = (model.centres.colwise() - point).colwise().squaredNorm();
  const VectorXf kernel = (squares.array() * static_cast<float>(-model.gamma)).exp();
  const Eigen::Vector2f change = model.weights * kernel;
  const auto limited = [&](float degrees) {
    return std::clamp(static_cast<double>(degrees), -model.max_deg, model.max_deg);
  };
  CorrectedDirection corrected;
  corrected.direction = {view.angles.pitch_deg + limited(change[0]),
                         std::clamp(view.angles.yaw_deg + limited(change[1]), -89.0, 89.0)};
  // d kernel_i / d f = 2 gamma kernel_i (f_i - f); f ends with (pitch, yaw, roll) / angle_scale.
  for (int by = 0; by < 2; ++by) {
    const Index row = point.size() - 3 + by;
    const VectorXf by_angle =
        (model.centres.row(row).transpose().array() - point[row]) * kernel.array() *
        static_cast<float>(2 * model.gamma / static_cast<double>(model.angle_scale[by]));
    const Eigen::Vector2f of_change = model.weights * by_angle;
    for (int axis = 0; axis < 2; ++axis)
      if (std::abs(change[axis]) < model.max_deg)
        corrected.jacobian(axis, by) += static_cast<double>(of_change[axis]);
  }
  return corrected;
}

std::optional<head::HeadPose> refined_pose(
    const CorrectedDirection& corrected, const HeadView& view,
    const head::HeadPoseEstimator& estimator, const Eigen::Matrix2Xd& points,
    const geometry::Camera& camera, const head::HeadPose& pose, const head::HeadIdentity* identity,
    const Eigen::VectorXd& sigma_px) {
  std::optional<head::HeadPose> refined =
      estimator
          .pose_towards(points, camera, rotation_towards(view, corrected.direction), identity,
                        sigma_px)
          .pose;
  if (refined) {
    refined->rotation_covariance = corrected_covariance(corrected, view, pose.rotation_covariance);
    head::calibrate_sigmas(*refined, kViewSigma);
  }
  return refined;
}

std::optional<head::HeadPose> refined_pose(const ViewModel& model,
                                           const head::HeadPoseEstimator& estimator,
                                           const Eigen::Matrix2Xd& points, const cv::Mat& gray,
                                           const geometry::Camera& camera,
                                           const head::HeadPose& pose,
                                           const head::HeadIdentity* identity,
                                           const Eigen::VectorXd& sigma_px) {
  const std::optional<HeadView> view =
      view_of_head(gray, camera, pose.camera_from_head, estimator.model(), points);
  // A head seen from behind shows no face.
  if (!view || std::abs(view->angles.yaw_deg) > 89) return std::nullopt;
  return refined_pose(correct_direction(model, *view), *view, estimator, points, camera, pose,
                      identity, sigma_px);
}

}  // namespace tarsier::face::head_view
