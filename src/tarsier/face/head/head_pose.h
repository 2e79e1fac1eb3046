// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/head/angle_sigma.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head/posit.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

#include <optional>
#include <string>
#include <vector>

// Pose of a head from its landmarks: POSIT with the mean head, then Gauss-Newton for pose and shape
// together. The result is the maximum a posteriori estimate, which minimises
//   sum_i w_i |x_i - project(R (mean_i + modes_i b) + t)|^2 / sigma_i^2 + sum_k b_k^2 /
//   deviation_k^2,
// where w_i is the robust weight, times a weight of the outline's far side in turned heads (as in
// training). sigma_i combines the model's noise of the point, in px at the head's distance, with
// the noise of the measurement, which is noise_px, or more according to `sigma_px`.
//
// By the normal equations at the solution, the covariance of the pose (w, t) and of c = b /
// deviation is (Hartley and Zisserman, Multiple View Geometry in Computer Vision, 2nd edition 2004,
// section 5.2; for robust weights: Huber, Robust Statistics, 1981, section 6.3)
//   cov = A^-1 B A^-1,  A = a J^T W J + P,  B = f J^T W J + P,  W = w_i / sigma_i^2,
// where P is the unit prior of c, and a and f are the expected effect of the robust weights on
// points without outliers. If all weights are 1, this is (J^T W J + P)^-1. In its first 3 x 3
// block, shape and translation are marginalised: it includes the uncertainty from shape differences
// that look like a rotation. If no sigma_px is given and the residuals are larger than noise_px and
// the model's noise explain, f grows with their scale (the upper quartile of their squares over
// that of a Gaussian). P is that of a single image even if earlier frames are known, because the
// errors of their landmarks are similar. Without `fit_shape`, A is for the pose alone, and the
// effect of the shape's variance is in B.
namespace tarsier::face::head {

// The default camera: no distortion, principal point in the middle of the image, focal length 1.3
// times the larger side (42 degrees field of view). This is between webcams and phones (0.7 .. 1)
// and portraits (1.4 .. 2.8). A wrong focal length scales the distance by the same factor and
// changes the rotation by a few degrees.
[[nodiscard]] geometry::Camera guess_camera(cv::Size image);

struct HeadPoseOptions {
  double noise_px = 1;          // of a landmark's coordinate, in addition to the model's
  bool fit_shape = true;        // false: keeps the shape of the mean head (or of the identity)
  int iterations = 8;           // of Gauss-Newton
  double robust_sigmas = 4;     // larger residuals get less weight
  std::vector<int> outline;     // model points, in addition to those of the model
  double outline_yaw_deg = 10;  // the weight of the outline's far side is exp(-(yaw / this)^2 / 2)
  // Share of each mode's variance that changes between frames of one person (expression); the rest
  // is identity.
  double expression_share = 0.05;
  // Factor per frame on the information about the identity.
  double memory = 0.995;

  [[nodiscard]] OptionFields fields() {
    return {{"noise_px", noise_px, range(0, 100)},
            {"iterations", iterations, range(1, 100)},
            {"robust_sigmas", robust_sigmas, above(0)},
            {"outline_yaw_deg", outline_yaw_deg, above(0)},
            {"expression_share", expression_share, range(0, 1)},
            {"memory", memory, above(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// The shape of one person, learned from earlier frames: a Gaussian of c = b / deviation in
// information form. Identity is constant, so each frame's normal equations are summed, with the
// pose eliminated by the Schur complement and expression added as noise. Older frames fade.
struct HeadIdentity {
  Eigen::MatrixXd information;  // m x m, without the prior (which is the unit matrix)
  Eigen::VectorXd vector;       // information * mean
  int frames = 0;

  // Most probable b; zero before the first frame.
  [[nodiscard]] Eigen::VectorXd shape(const HeadModel& model) const;
};

struct HeadPose {
  geometry::Rigid3 camera_from_head;  // mm
  HeadAngles angles;
  Eigen::VectorXd b;  // of this frame
  double rms_px = 0;  // weighted
  // Covariance of the rotation's error w, rad^2 (head/angle_sigma.h): the true rotation is
  // exp([w]x) rotation.
  Eigen::Matrix3d rotation_covariance = Eigen::Matrix3d::Zero();
  // Standard deviations of the angles' errors, up to 180.
  double yaw_sigma_deg = 0;
  double pitch_sigma_deg = 0;
  double roll_sigma_deg = 0;
  // For yaw, pitch and roll: the part of these that is the calibration's floor, which is the same
  // for every image.
  Eigen::Vector3d sigma_floor_deg = Eigen::Vector3d::Zero();
};

// Sets the angles and their deviations from rotation and rotation_covariance.
void set_angles(HeadPose& pose);
// Calibrates the covariance and sets the angles.
void calibrate_sigmas(HeadPose& pose, const AngleCalibration& calibration);

// A pose, or why there is none.
struct HeadPoseResult {
  std::optional<HeadPose> pose;
  std::string reason;
};

class HeadPoseEstimator {
 public:
  // Throws std::invalid_argument for an invalid model or invalid options.
  explicit HeadPoseEstimator(HeadModel model, HeadPoseOptions options = {});

  [[nodiscard]] const HeadModel& model() const { return model_; }
  [[nodiscard]] const HeadPoseOptions& options() const { return options_; }

  // points: 2 x n px in the order of the model's points, NaN where missing; at least 6 points that
  // are not coplanar are needed. For another markup, use a LandmarkMapping: the estimator of
  // select_points(model, mapping.model_points), and landmarks(Eigen::all, mapping.landmarks).
  // No pose is returned for too few points, or points that are not a head (the iteration moves it
  // behind the camera).
  // sigma_px: n, each above 0: the distance from the true position that 68 % of such measurements
  // stay within (regression/visibility.h), so that hidden points get less weight; empty: unknown.
  [[nodiscard]] HeadPoseResult pose(const Eigen::Matrix2Xd& points, const geometry::Camera& camera,
                                    const Eigen::VectorXd& sigma_px = {}) const;
  // The same with the identity from earlier frames, which is updated by this frame. If there is no
  // pose, `identity` is not changed.
  [[nodiscard]] HeadPoseResult pose(const Eigen::Matrix2Xd& points, const geometry::Camera& camera,
                                    HeadIdentity& identity,
                                    const Eigen::VectorXd& sigma_px = {}) const;

  // The pose whose head looks in the same direction as with `camera_from_head`. Only the direction
  // of the head's z axis is fixed; the rotation about it, the translation and the shape are
  // estimated. `identity` may be null; it is not changed. The angles are those of the estimated
  // rotation. The covariance is computed from the points alone, as if they determined the
  // direction.
  [[nodiscard]] HeadPoseResult pose_towards(const Eigen::Matrix2Xd& points,
                                            const geometry::Camera& camera,
                                            const Eigen::Matrix3d& camera_from_head,
                                            const HeadIdentity* identity = nullptr,
                                            const Eigen::VectorXd& sigma_px = {}) const;

  // The head's points in the image, 2 x n px; NaN behind the camera.
  [[nodiscard]] Eigen::Matrix2Xd project(const HeadPose& pose,
                                         const geometry::Camera& camera) const;

 private:
  [[nodiscard]] HeadPoseResult solve(const Eigen::Matrix2Xd& points,
                                     const Eigen::VectorXd& sigma_px,
                                     const geometry::Camera& camera, const HeadIdentity* known,
                                     HeadIdentity* learning, const Eigen::Matrix3d* towards) const;

  HeadModel model_;
  HeadPoseOptions options_;
  std::vector<char> is_outline_;
  PositModel mean_;         // of the mean head
  Eigen::MatrixXd scaled_;  // modes times deviation, transposed: m x 3n
  // Expectations over points without outliers whose variance is `scale` times the assumed one: of
  // the robust weight, of the squared influence of a residual, and of the derivative of that
  // influence.
  struct RobustMeans {
    double weight = 1;
    double square = 1;
    double derivative = 1;
  };
  [[nodiscard]] RobustMeans robust_means(double scale) const;
  // Covariance of the rotation, rad^2, from the normal equations of pose and shape, without the
  // prior. squared_residuals: squared residuals over their variances, if the variances are to be
  // scaled by them; otherwise empty.
  [[nodiscard]] Eigen::Matrix3d covariance_of(const Eigen::MatrixXd& normal,
                                              std::vector<double> squared_residuals,
                                              bool with_shape) const;
  RobustMeans robust_;
};

}  // namespace tarsier::face::head
