// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/head/head_identity.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

namespace tarsier::face::head {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

constexpr int kMinPoints = 6;
// For a Gaussian of deviation 1 in both coordinates, 68 % are within this radius: sqrt(-2 ln 0.32).
constexpr double kRadiusOf68 = 1.51;

// Restricts the rotation in the normal equations (the first three unknowns) to the unit vector
// `axis`; the other components of the solution are 0.
void restrict_rotation_to(const Vector3d& axis, MatrixXd& normal, VectorXd& right) {
  const Matrix3d share = axis * axis.transpose();
  normal.topRows<3>() = (share * normal.topRows<3>()).eval();
  normal.leftCols<3>() = (normal.leftCols<3>() * share).eval();
  normal.topLeftCorner<3, 3>() += Matrix3d::Identity() - share;
  right.head<3>() = (share * right.head<3>()).eval();
}

}  // namespace

HeadPoseResult HeadPoseEstimator::solve(const Matrix2Xd& points, const VectorXd& sigma_px,
                                        const geometry::Camera& camera, const HeadIdentity* known,
                                        HeadIdentity* learning,
                                        const Eigen::Matrix3d* towards) const {
  camera.check();
  const Index n = model_.points();
  if (points.cols() != n)
    return {std::nullopt, "the landmarks are not as many as the model's points"};
  TARSIER_REQUIRE(sigma_px.size() == 0 || (sigma_px.size() == n && sigma_px.minCoeff() > 0),
                  "{} deviations of {} points, or one that is not above 0", sigma_px.size(), n);
  // Normalised coordinates without missing points.
  Matrix2Xd normalized(2, n);
  std::vector<Index> present;
  for (Index i = 0; i < n; ++i) {
    if (!points.col(i).allFinite()) continue;
    const auto point = camera.normalized_of({points(0, i), points(1, i)});
    if (!point) continue;
    normalized.col(i) << point->x, point->y;
    present.push_back(i);
  }
  if (present.size() < kMinPoints) return {std::nullopt, "fewer than 6 landmarks are there"};

  PositOptions posit_options;
  posit_options.tolerance = 1e-3;
  posit_options.refine_steps = 3;
  PositWorkspace workspace;
  PositResult start;
  if (present.size() == static_cast<std::size_t>(n)) {
    start = posit(mean_, normalized, posit_options, workspace);
  } else {
    const VectorXd weights = model_.noise.array().square().inverse();
    start = posit(PositModel(model_.mean(Eigen::all, present), weights(present)),
                  normalized(Eigen::all, present), posit_options, workspace);
  }
  if (!start.pose) return {std::nullopt, start.reason};

  // c = b / deviation: prior with mean `expected` and information `prior`.
  const Index all_modes = model_.mode_count();
  const Index m = options_.fit_shape ? all_modes : 0;
  VectorXd expected = VectorXd::Zero(all_modes);
  MatrixXd prior = MatrixXd::Identity(m, m);
  const bool is_known = known != nullptr && known->frames > 0;
  if (is_known) {
    const MatrixXd information = known->information + MatrixXd::Identity(all_modes, all_modes);
    const linalg::Cholesky factor(information);
    expected = factor.solve(known->vector);
    if (m > 0) {
      MatrixXd covariance = factor.solve(MatrixXd::Identity(m, m));
      covariance.diagonal().array() += options_.expression_share;
      prior = linalg::Cholesky(covariance).solve(MatrixXd::Identity(m, m));
    }
  }
  const double focal = std::sqrt(camera.fx * camera.fy);
  auto [rotation, translation] = start.pose->camera_from_object;
  if (towards) rotation = *towards;
  VectorXd c = expected;
  const Index solved = 6 + m;  // unknowns; the following ones are a shape that is not fitted
  const Index size = 6 + all_modes;
  MatrixXd normal(size, size);
  VectorXd right(size);
  const auto rows = static_cast<Index>(2 * present.size());
  MatrixXd jacobian(size, rows);  // transposed, each row divided by its standard deviation
  VectorXd residuals(rows);
  Eigen::MatrixX3d turned(all_modes, 3);
  Matrix3Xd shape(3, n);
  double sum = 0;
  double weight_sum = 0;
  std::vector<double> squared_residuals;  // squared residuals divided by their variances
  bool is_done = false;
  for (int iteration = 0; iteration <= options_.iterations; ++iteration) {
    shape = model_.mean;
    if (all_modes > 0) Eigen::Map<VectorXd>(shape.data(), 3 * n) += scaled_.transpose() * c;
    const double yaw = angles_of_rotation(rotation).yaw_deg;
    const double far = std::exp(-0.5 * std::pow(yaw / options_.outline_yaw_deg, 2));
    sum = weight_sum = 0;
    squared_residuals.clear();
    Index row = 0;
    for (const Index i : present) {
      const Vector3d q = rotation * shape.col(i);
      const Vector3d x = q + translation;
      if (!(x[2] > 1)) return {std::nullopt, "the points come out behind the camera"};
      const double inverse = 1 / x[2];
      const double u = x[0] * inverse;
      const double v = x[1] * inverse;
      const Vector2d residual(normalized(0, i) - u, normalized(1, i) - v);
      const double measured = sigma_px.size() == 0
                                  ? options_.noise_px
                                  : std::max(options_.noise_px, sigma_px[i] / kRadiusOf68);
      const double sigma = std::hypot(model_.noise[i] * inverse, measured / focal);
      const double squared_ratio =
          residual.squaredNorm() / std::pow(options_.robust_sigmas * sigma, 2);
      double weight = 1 / ((1 + squared_ratio) * (1 + squared_ratio));
      if (is_outline_[static_cast<std::size_t>(i)] != 0 && shape(0, i) * yaw < 0) weight *= far;
      sum += weight * residual.squaredNorm();
      weight_sum += weight;
      if (sigma_px.size() == 0)
        squared_residuals.push_back(residual.squaredNorm() / (sigma * sigma));
      const double root = std::sqrt(weight) / sigma;
      const double part = root * inverse;
      jacobian.col(row).head<6>() << -part * u * q[1], part * (q[2] + u * q[0]), -part * q[1], part,
          0, -part * u;
      jacobian.col(row + 1).head<6>() << -part * (q[2] + v * q[1]), part * v * q[0], part * q[0], 0,
          part, -part * v;
      if (all_modes > 0) {
        turned.noalias() = scaled_.middleCols<3>(3 * i) * rotation.transpose();
        jacobian.col(row).tail(all_modes) = part * (turned.col(0) - u * turned.col(2));
        jacobian.col(row + 1).tail(all_modes) = part * (turned.col(1) - v * turned.col(2));
      }
      residuals.segment<2>(row) = root * residual;
      row += 2;
    }
    normal.setZero();
    normal.selfadjointView<Eigen::Lower>().rankUpdate(jacobian);
    normal.triangularView<Eigen::StrictlyUpper>() = normal.transpose();
    right.noalias() = jacobian * residuals;
    if (iteration == options_.iterations || is_done) break;
    MatrixXd with_prior = normal.topLeftCorner(solved, solved);
    VectorXd pull = right.head(solved);
    with_prior.bottomRightCorner(m, m) += prior;
    if (m > 0) pull.tail(m) -= prior * (c - expected);
    if (towards != nullptr) restrict_rotation_to(rotation.col(2), with_prior, pull);
    const linalg::Cholesky factor(with_prior);
    if (!factor.ok()) return {std::nullopt, "the landmarks do not determine the pose"};
    const VectorXd update = factor.solve(pull);
    if (!update.allFinite()) return {std::nullopt, "the landmarks do not determine the pose"};
    const Vector3d spin = update.head<3>();
    if (spin.norm() > 0) {
      rotation =
          Eigen::AngleAxisd(std::min(spin.norm(), 0.5), spin.normalized()).toRotationMatrix() *
          rotation;
    }
    translation += update.segment<3>(3);
    if (m > 0) c += update.tail(m);
    // Converged: less than a hundredth of a degree and of a deviation, and a ten-thousandth of the
    // distance. One more linearisation follows.
    is_done = spin.norm() < 1e-4 && update.segment<3>(3).norm() < 1e-4 * translation.norm() &&
              (m == 0 || update.tail(m).cwiseAbs().maxCoeff() < 5e-3);
  }

  if (learning != nullptr && m > 0) add_frame(normal, right, c, options_, *learning);

  HeadPose found;
  found.camera_from_head = {rotation, translation};
  found.rotation_covariance =
      covariance_of(normal, std::move(squared_residuals), m > 0 || all_modes == 0);
  // The last linearisation is degenerate: the points do not determine the rotation.
  if (!found.rotation_covariance.allFinite())
    found.rotation_covariance = std::pow(std::numbers::pi, 2) * Matrix3d::Identity();
  set_angles(found);
  found.b = c.cwiseProduct(model_.deviation);
  found.rms_px = focal * std::sqrt(sum / std::max(weight_sum, 1e-12));
  return {std::move(found), ""};
}

}  // namespace tarsier::face::head
