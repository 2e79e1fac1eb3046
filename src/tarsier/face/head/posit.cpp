// SPDX-License-Identifier: MIT
#include "tarsier/face/head/posit.h"

#include "tarsier/core/require.h"
#include "tarsier/face/head/posit_solver.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Eigenvalues>

#include <cmath>
#include <limits>
#include <numbers>

namespace tarsier::face::head {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kMinFlatness = 1e-3;

}  // namespace

PositModel::PositModel(const Eigen::Matrix3Xd& points, const Eigen::VectorXd& weights,
                       int reference)
    : reference_(reference) {
  const Index n = points.cols();
  TARSIER_REQUIRE(weights.size() == 0 || weights.size() == n, "{} weights for {} points",
                  weights.size(), n);
  TARSIER_REQUIRE(weights.size() == 0 || (weights.allFinite() && weights.minCoeff() >= 0),
                  "a weight is below 0 or not finite");
  TARSIER_REQUIRE(reference >= 0 && (reference < n || n == 0), "reference {} of {} points",
                  reference, n);
  from_centroid_.resize(n, 3);
  const Index counted = weights.size() == 0 ? n : (weights.array() > 0).count();
  if (counted < 4) {
    defect_ = planar_defect_ = "at least 4 points are needed";
    return;
  }
  if (!points.allFinite()) {
    defect_ = planar_defect_ = "a point of the object is not finite";
    return;
  }
  weights_ = weights.size() == 0 ? Eigen::VectorXd::Ones(n) : weights;
  weights_ *= static_cast<double>(n) / weights_.sum();
  centroid_ = points * weights_ / static_cast<double>(n);
  from_centroid_ = (points.colwise() - centroid_).transpose();
  reference_point_ = points.col(reference);
  from_reference_ = (points.colwise() - reference_point_).transpose();

  const Matrix3d scatter = from_centroid_.transpose() * weights_.asDiagonal() * from_centroid_;
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(scatter);
  const Vector3d extent = solver.eigenvalues().cwiseMax(0).cwiseSqrt();  // ascending
  if (!std::isfinite(extent[2]) || !(extent[2] > 0)) {
    defect_ = planar_defect_ = "the points of the object have no extent";
    return;
  }
  if (extent[1] < kMinFlatness * extent[2]) {
    defect_ = planar_defect_ = "the points of the object are collinear";
    return;
  }
  flatness_ = extent[0] / extent[2];
  normal_ = solver.eigenvectors().col(0);
  const Matrix3d plane = solver.eigenvectors().rightCols<2>() *
                         solver.eigenvalues().tail<2>().cwiseInverse().asDiagonal() *
                         solver.eigenvectors().rightCols<2>().transpose();
  planar_inverse_ = weights_.asDiagonal() * from_centroid_ * plane;
  if (flatness_ < kMinFlatness) {
    defect_ = "the points of the object are coplanar: two poses fit them (near-planar form)";
    return;
  }
  inverse_ = weights_.asDiagonal() * from_centroid_ * scatter.inverse();
  const Matrix3d around = from_reference_.transpose() * from_reference_;
  reference_inverse_ = from_reference_ * around.inverse();
}

namespace {

// Copies image points into the workspace; returns the reason if that is impossible, or "".
const char* load(const PositModel& model, const Eigen::Ref<const Eigen::Matrix2Xd>& image,
                 PositWorkspace& space) {
  if (image.cols() != model.points()) return "the image's points are not as many as the object's";
  if (!image.allFinite()) return "a point in the image is not finite";
  space.x = image.row(0).transpose();
  space.y = image.row(1).transpose();
  space.w.setOnes(image.cols());
  space.wx.resize(image.cols());
  space.wy.resize(image.cols());
  return "";
}

}  // namespace

PositResult posit(const PositModel& model, const Eigen::Ref<const Eigen::Matrix2Xd>& image,
                  const PositOptions& options, PositWorkspace& workspace) {
  options.check();
  if (*model.defect() != 0) return {std::nullopt, model.defect()};
  if (const char* trouble = load(model, image, workspace); *trouble != 0)
    return {std::nullopt, trouble};
  PositSolver solver{model, options, workspace};
  return options.method == PositMethod::kClassic ? solver.classic() : solver.homogeneous();
}

PositResult posit(const PositModel& model, const Eigen::Ref<const Eigen::Matrix2Xd>& image,
                  const geometry::Camera& camera, const PositOptions& options,
                  PositWorkspace& workspace) {
  camera.check();
  if (!image.allFinite()) return {std::nullopt, "a point in the image is not finite"};
  workspace.normalized.resize(2, image.cols());
  if (camera.is_distorted()) {
    for (Index i = 0; i < image.cols(); ++i) {
      const auto point = camera.normalized_of({image(0, i), image(1, i)});
      if (!point)
        return {std::nullopt, "a point lies where the camera's distortion has no inverse"};
      workspace.normalized.col(i) << point->x, point->y;
    }
  } else {
    workspace.normalized.row(0) = (image.row(0).array() - camera.cx) / camera.fx;
    workspace.normalized.row(1) = (image.row(1).array() - camera.cy) / camera.fy;
  }
  PositResult result = posit(model, workspace.normalized, options, workspace);
  if (result.pose) result.pose->rms *= std::sqrt(camera.fx * camera.fy);
  return result;
}

std::optional<PositSigma> posit_sigma(const Eigen::Matrix3Xd& points, const Eigen::Matrix2Xd& image,
                                      const geometry::Camera& camera,
                                      const geometry::Rigid3& camera_from_object) {
  TARSIER_REQUIRE(points.cols() == image.cols(), "{} points of an object, {} in the image",
                  points.cols(), image.cols());
  if (points.cols() < 4) return std::nullopt;
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  double squares = 0;
  for (Index i = 0; i < points.cols(); ++i) {
    const auto seen = camera.normalized_of({image(0, i), image(1, i)});
    const Vector3d q = camera_from_object.rotation * points.col(i);
    const Vector3d x = q + camera_from_object.translation;
    if (!seen || !(x[2] > 0)) return std::nullopt;
    const double u = x[0] / x[2];
    const double v = x[1] / x[2];
    Eigen::Matrix<double, 2, 6> jacobian;
    jacobian << -u * q[1], q[2] + u * q[0], -q[1], 1, 0, -u,  //
        -(q[2] + v * q[1]), v * q[0], q[0], 0, 1, -v;
    jacobian /= x[2];
    normal += jacobian.transpose() * jacobian;
    squares += (seen->x - u) * (seen->x - u) + (seen->y - v) * (seen->y - v);
  }
  const linalg::Cholesky factor(normal);
  if (!factor.ok()) return std::nullopt;
  const Eigen::Matrix<double, 6, 1> variance =
      squares / static_cast<double>(2 * points.cols() - 6) *
      factor.solve(Eigen::MatrixXd::Identity(6, 6)).diagonal();
  if (!variance.allFinite() || variance.minCoeff() < 0) return std::nullopt;
  return PositSigma{variance.head<3>().cwiseSqrt() * (180 / std::numbers::pi),
                    variance.tail<3>().cwiseSqrt()};
}

PlanarPositResult posit_planar(const PositModel& model,
                               const Eigen::Ref<const Eigen::Matrix2Xd>& image,
                               const PositOptions& options, PositWorkspace& workspace) {
  options.check();
  if (*model.planar_defect() != 0) return {{}, model.planar_defect()};
  if (const char* trouble = load(model, image, workspace); *trouble != 0) return {{}, trouble};
  PositSolver solver{model, options, workspace};
  return solver.planar();
}

}  // namespace tarsier::face::head
