// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_pose.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace tarsier::face::head {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd inverse_variances(const HeadModel& model) {
  return model.noise.array().square().inverse();
}

}  // namespace

geometry::Camera guess_camera(cv::Size image) {
  TARSIER_REQUIRE(image.width > 0 && image.height > 0, "an image of {} x {}", image.width,
                  image.height);
  geometry::Camera camera;
  camera.width = image.width;
  camera.height = image.height;
  camera.fx = camera.fy = 1.3 * std::max(image.width, image.height);
  camera.cx = (image.width - 1) / 2.0;
  camera.cy = (image.height - 1) / 2.0;
  return camera;
}

HeadPoseEstimator::HeadPoseEstimator(HeadModel model, HeadPoseOptions options)
    : model_((model.check(), std::move(model))),
      options_(std::move(options)),
      mean_(model_.mean, inverse_variances(model_)) {
  options_.check();
  robust_ = robust_means(1);
  scaled_ = (model_.modes * model_.deviation.asDiagonal()).transpose();
  is_outline_.assign(static_cast<std::size_t>(model_.points()), 0);
  for (const int i : model_.outline) is_outline_[static_cast<std::size_t>(i)] = 1;
  for (const int i : options_.outline) {
    TARSIER_REQUIRE(i >= 0 && i < model_.points(), "outline point {} of {}", i, model_.points());
    is_outline_[static_cast<std::size_t>(i)] = 1;
  }
}

// x = half the squared residual over its true variance, with density exp(-x) for Gaussian residuals
// of two coordinates. The weight is w = (1 + scale x / a)^-2 with a = robust_sigmas^2 / 2. The
// influence of a residual r on the estimate is r w; for each coordinate E[(r w)^2] = scale E[x w^2]
// and E[d(r w)/dr] = E[w + x dw/dx].
HeadPoseEstimator::RobustMeans HeadPoseEstimator::robust_means(double scale) const {
  const double a = options_.robust_sigmas * options_.robust_sigmas / 2 / scale;
  constexpr int kSteps = 1000;  // of Simpson's rule, up to where the density vanishes
  constexpr double kEnd = 30;
  RobustMeans means{0, 0, 0};
  for (int k = 0; k <= kSteps; ++k) {
    const double x = kEnd * k / kSteps;
    const double share = (k == 0 || k == kSteps ? 1 : k % 2 == 1 ? 4 : 2) * kEnd / (3.0 * kSteps);
    const double density = share * std::exp(-x);
    const double w = 1 / ((1 + x / a) * (1 + x / a));
    means.weight += density * w;
    means.square += density * scale * w * w * x;
    means.derivative += density * (w - 2 * x / a * w / (1 + x / a));
  }
  return means;
}

Matrix3d HeadPoseEstimator::covariance_of(const MatrixXd& normal,
                                          std::vector<double> squared_residuals,
                                          bool with_shape) const {
  const Index m = normal.rows() - 6;
  const Index solved = with_shape ? 6 + m : 6;
  const auto with_prior = [&](const MatrixXd& of_points) {
    MatrixXd sum = of_points.topLeftCorner(solved, solved);
    sum.diagonal().tail(solved - 6).array() += 1;
    return sum;
  };
  RobustMeans means = robust_;
  linalg::Cholesky curvature(with_prior(normal * (means.derivative / means.weight)));
  if (!squared_residuals.empty() && with_shape) {
    // Three quarters of half the squared residuals are below ln 4 times the variance. The degrees
    // of freedom of the fit are corrected for.
    const double fitted_freedom =
        curvature.solve(normal * (means.derivative / means.weight)).trace();
    const double remaining_freedom =
        1 - fitted_freedom / (2.0 * static_cast<double>(squared_residuals.size()));
    std::sort(squared_residuals.begin(), squared_residuals.end());
    const double variance = quantile(squared_residuals, 0.75) / 2 / (2 * std::numbers::ln2);
    const double scale = variance / std::max(remaining_freedom, 0.1);
    if (scale > 1) {
      means = robust_means(scale);
      curvature.compute(with_prior(normal * (means.derivative / means.weight)));
    }
  }
  MatrixXd spread = with_prior(normal * (means.square / means.weight));
  if (!with_shape) {
    const MatrixXd of_shape = normal.topRightCorner(6, m) * (means.derivative / means.weight);
    spread += of_shape * of_shape.transpose();
  }
  const MatrixXd of_rotation = curvature.solve(MatrixXd::Identity(solved, 3));
  return of_rotation.transpose() * spread * of_rotation;
}

void set_angles(HeadPose& pose) {
  pose.angles = angles_of_rotation(pose.camera_from_head.rotation);
  const Matrix3d covariance = angle_covariance(pose.angles, pose.rotation_covariance);
  const auto deviation = [&](int axis) {
    return std::min(180.0, std::sqrt(std::max(0.0, covariance(axis, axis))));
  };
  pose.yaw_sigma_deg = deviation(0);
  pose.pitch_sigma_deg = deviation(1);
  pose.roll_sigma_deg = deviation(2);
}

void calibrate_sigmas(HeadPose& pose, const AngleCalibration& calibration) {
  const HeadAngles angles = angles_of_rotation(pose.camera_from_head.rotation);
  pose.rotation_covariance = rotation_covariance(
      angles, calibrated(angle_covariance(angles, pose.rotation_covariance), calibration));
  pose.sigma_floor_deg = floor_of(calibration);
  set_angles(pose);
}

HeadPoseResult HeadPoseEstimator::pose(const Matrix2Xd& points, const geometry::Camera& camera,
                                       const VectorXd& sigma_px) const {
  return solve(points, sigma_px, camera, nullptr, nullptr, nullptr);
}

HeadPoseResult HeadPoseEstimator::pose(const Matrix2Xd& points, const geometry::Camera& camera,
                                       HeadIdentity& identity, const VectorXd& sigma_px) const {
  const Index m = model_.mode_count();
  TARSIER_REQUIRE(identity.frames == 0 || identity.vector.size() == m,
                  "an identity of {} modes for a model of {}", identity.vector.size(), m);
  return solve(points, sigma_px, camera, &identity, &identity, nullptr);
}

HeadPoseResult HeadPoseEstimator::pose_towards(const Matrix2Xd& points,
                                               const geometry::Camera& camera,
                                               const Eigen::Matrix3d& camera_from_head,
                                               const HeadIdentity* identity,
                                               const VectorXd& sigma_px) const {
  TARSIER_REQUIRE(identity == nullptr || identity->frames == 0 ||
                      identity->vector.size() == model_.mode_count(),
                  "an identity of {} modes for a model of {}", identity->vector.size(),
                  model_.mode_count());
  TARSIER_REQUIRE(geometry::is_rotation(camera_from_head, 1e-3), "not a rotation");
  return solve(points, sigma_px, camera, identity, nullptr, &camera_from_head);
}

Matrix2Xd HeadPoseEstimator::project(const HeadPose& pose, const geometry::Camera& camera) const {
  const Matrix3Xd shape = shape_of(model_, pose.b);
  Matrix2Xd pixels(2, shape.cols());
  pixels.setConstant(std::numeric_limits<double>::quiet_NaN());
  for (Index i = 0; i < shape.cols(); ++i) {
    if (const auto pixel = camera.project(pose.camera_from_head * shape.col(i)))
      pixels.col(i) << pixel->x, pixel->y;
  }
  return pixels;
}

}  // namespace tarsier::face::head
