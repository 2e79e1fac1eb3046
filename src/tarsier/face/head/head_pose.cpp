// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_pose.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>

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
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

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

VectorXd HeadIdentity::shape(const HeadModel& model) const {
  const Index m = model.mode_count();
  if (frames == 0) return VectorXd::Zero(m);
  TARSIER_REQUIRE(vector.size() == m, "an identity of {} modes for a model of {}", vector.size(),
                  m);
  const MatrixXd with_prior = information + MatrixXd::Identity(m, m);
  return linalg::Cholesky(with_prior).solve(vector).cwiseProduct(model.deviation);
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
    start = posit(PositModel(model_.mean(Eigen::all, present), inverse_variances(model_)(present)),
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

  if (learning != nullptr && m > 0) {
    // Information of this frame on c with the pose eliminated; expression is noise in the same
    // directions.
    const linalg::Cholesky pose_part(normal.topLeftCorner(6, 6));
    const MatrixXd coupling = pose_part.solve(normal.topRightCorner(6, m));
    MatrixXd information =
        normal.bottomRightCorner(m, m) - normal.bottomLeftCorner(m, 6) * coupling;
    VectorXd vector = right.tail(m) - coupling.transpose() * right.head(6) + information * c;
    const MatrixXd softened = MatrixXd::Identity(m, m) + options_.expression_share * information;
    information = linalg::solve_general(softened, information);
    vector = linalg::solve_general(softened, vector);
    information = (information + information.transpose()).eval() / 2;
    if (information.allFinite() && vector.allFinite()) {
      if (learning->frames == 0) {
        learning->information = MatrixXd::Zero(m, m);
        learning->vector = VectorXd::Zero(m);
      }
      learning->information = options_.memory * learning->information + information;
      learning->vector = options_.memory * learning->vector + vector;
      ++learning->frames;
    }
  }
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
