// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>

#include <array>
#include <optional>

// Pose of a known object from one image. With x_i = X_i / Z_i in normalised camera coordinates
// (camera: x right, y down, z forward) and s = 1 / T_z,
//   w_i x_i = s (r1 . P_i + T_x),  w_i y_i = s (r2 . P_i + T_y),  w_i = 1 + s r3 . P_i:
// linear in the pose once w is known. POSIT starts with w = 1 (scaled orthography), solves with the
// object's pseudo-inverse, which is computed once, makes the rows orthonormal, and updates w from
// the result.
//   classic:     P_i relative to a reference point whose projection is assumed to be exact
//                (DeMenton and Davis, "Model-based object pose in 25 lines of code", IJCV 1995)
//   homogeneous: all points have the same role, the translation is estimated too (DeMenton, David
//                and Samarin's form); P_i relative to the centroid
// The translation has the unit of the object's points.
namespace tarsier::face::head {

enum class PositMethod { kClassic, kHomogeneous };

struct PositOptions {
  PositMethod method = PositMethod::kHomogeneous;
  int max_iterations = 50;
  // Stops when no w changes by more than this.
  double tolerance = 1e-6;
  // Levenberg-Marquardt steps on the weighted reprojection error afterwards.
  int refine_steps = 0;

  [[nodiscard]] OptionFields fields() {
    return {{"max_iterations", max_iterations, range(1, 1000)},
            {"tolerance", tolerance, range(1e-12, 1e-2)},
            {"refine_steps", refine_steps, range(0, 50)}};
  }
  void check() const { check_fields(*this); }
};

struct PositPose {
  geometry::Rigid3 camera_from_object;
  // Root mean squared reprojection error, in the unit of the image points.
  double rms = 0;
  int iterations = 0;
  bool converged = false;
};

// A pose, or the reason why there is none in one line (otherwise "").
struct PositResult {
  std::optional<PositPose> pose;
  const char* reason = "";
};

// An object: its points (3 x n) and what POSIT needs of them. Points may have weights (empty: all
// 1; >= 0), used in the pseudo-inverse and the refinement; the classic form ignores them. Throws
// std::invalid_argument for a wrong number of weights, negative weights, and a reference out of
// range. If the points allow no pose, the model has a defect, which posit() reports.
class PositModel {
 public:
  explicit PositModel(const Eigen::Matrix3Xd& points, const Eigen::VectorXd& weights = {},
                      int reference = 0);

  [[nodiscard]] int points() const { return static_cast<int>(from_centroid_.rows()); }
  // Why posit() cannot solve this object: fewer than 4 points, not finite, collinear, coplanar
  // (thinner than 1e-3 of its width: the pseudo-inverse would amplify noise by the inverse of this
  // ratio); "" if it can.
  [[nodiscard]] const char* defect() const { return defect_; }
  // The same for posit_planar(), which accepts coplanar objects.
  [[nodiscard]] const char* planar_defect() const { return planar_defect_; }
  // Smallest over largest extent (singular values of the centred points): 0 is coplanar.
  [[nodiscard]] double flatness() const { return flatness_; }

 private:
  friend struct PositSolver;
  int reference_ = 0;
  Eigen::Vector3d centroid_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d reference_point_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal_ = Eigen::Vector3d::UnitZ();  // of the plane through the points
  Eigen::MatrixX3d from_centroid_;                     // n x 3
  Eigen::MatrixX3d from_reference_;
  Eigen::MatrixX3d inverse_;            // transposed pseudo-inverse of from_centroid_
  Eigen::MatrixX3d planar_inverse_;     // the same of rank 2, within the plane
  Eigen::MatrixX3d reference_inverse_;  // of from_reference_
  Eigen::VectorXd weights_;             // sum n
  double flatness_ = 0;
  const char* defect_ = "";
  const char* planar_defect_ = "";
};

// Buffers that are reused between calls: further calls with the same number of points allocate
// nothing. One per thread.
struct PositWorkspace {
  Eigen::VectorXd x, y, w, wx, wy;
  Eigen::Matrix2Xd normalized;
};

// image: 2 x n, normalised camera coordinates (x/z, y/z). No pose if the object has a defect, the
// numbers of points differ, a coordinate is not finite, or the points are behind the camera. A pose
// that has not converged is also returned (see PositPose::converged).
[[nodiscard]] PositResult posit(const PositModel& model,
                                const Eigen::Ref<const Eigen::Matrix2Xd>& image,
                                const PositOptions& options, PositWorkspace& workspace);

// image: 2 x n in px; rms in px of the undistorted image (times the geometric mean of fx and fy).
[[nodiscard]] PositResult posit(const PositModel& model,
                                const Eigen::Ref<const Eigen::Matrix2Xd>& image,
                                const geometry::Camera& camera, const PositOptions& options,
                                PositWorkspace& workspace);

// Standard deviations of a pose, estimated from the residuals: cov = s^2 (J^T J)^-1 with J of the
// projections by a small rotation and translation in the camera's frame and s^2 = sum of squares /
// (2n - 6) (Hartley and Zisserman, Multiple View Geometry in Computer Vision, 2nd edition 2004,
// section 5.2).
struct PositSigma {
  Eigen::Vector3d rotation_deg;  // about the camera's x, y and z axis
  Eigen::Vector3d translation;   // unit of the object
};
// points: 3 x n; image: 2 x n, px of `camera`. For a least-squares (refined) pose; the residuals of
// POSIT alone are larger. Empty for fewer than 4 points, or if the points do not determine the
// pose.
[[nodiscard]] std::optional<PositSigma> posit_sigma(const Eigen::Matrix3Xd& points,
                                                    const Eigen::Matrix2Xd& image,
                                                    const geometry::Camera& camera,
                                                    const geometry::Rigid3& camera_from_object);

// For coplanar and nearly coplanar objects, which look nearly the same from two directions: returns
// both solutions, the one with the smaller error first. The second is missing if they coincide
// (Oberkampf, DeMenton and Davis, "Iterative pose estimation using coplanar feature points", CVIU
// 1996). Each is refined with all three coordinates of the points (at least 10 steps).
struct PlanarPositResult {
  std::array<std::optional<PositPose>, 2> poses;
  const char* reason = "";
};
[[nodiscard]] PlanarPositResult posit_planar(const PositModel& model,
                                             const Eigen::Ref<const Eigen::Matrix2Xd>& image,
                                             const PositOptions& options,
                                             PositWorkspace& workspace);

}  // namespace tarsier::face::head
