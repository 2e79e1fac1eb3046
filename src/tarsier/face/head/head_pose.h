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
// together, the most probable given
//   sum_i w_i |x_i - project(R (mean_i + modes_i b) + t)|^2 / sigma_i^2 + sum_k b_k^2 /
//   deviation_k^2,
// sigma_i = the model's noise of the point, in px at the head's distance, and of its measurement
// together: noise_px, or more where `sigma_px` says so;
// w_i = robust weight, times that of the outline's far side in turned heads (as in training).
//
// The covariance of the pose (w, t) and of c = b / deviation is, by the normal equations at the
// solution (Hartley and Zisserman, Multiple View Geometry in Computer Vision, 2nd edition 2004,
// section 5.2; of robust weights: Huber, Robust Statistics, 1981, section 6.3),
//   cov = A^-1 B A^-1,  A = a J^T W J + P,  B = f J^T W J + P,  W = w_i / sigma_i^2,
// P the unit prior of c, a and f what the robust weights do to points without outliers; with all
// weights 1 that is (J^T W J + P)^-1. Its first 3 x 3 block has shape and translation marginalised:
// what people differ by from the mean head, as far as it could also be a turn, is in it. Where no
// sigma_px is given and the residuals are larger than noise_px and the model's noise explain, f
// grows with their scale (the upper quartile of their squares over that of a Gaussian). P is that of
// one image also where earlier frames are known: their landmarks err alike. Without `fit_shape` A is
// of the pose alone, and what the shape's variance does to it is in B.
namespace tarsier::face::head {

// The head's own camera where none is known: no distortion, the middle of the image, focal length
// 1.3 times its larger side (42 degrees across): between webcams and phones, which have 0.7 .. 1,
// and portraits, which have 1.4 .. 2.8. A focal length that is wrong by a factor makes the distance
// wrong by as much, the rotation by a few degrees.
[[nodiscard]] geometry::Camera guess_camera(cv::Size image);

struct HeadPoseOptions {
  double noise_px = 1;          // of a landmark's coordinate, beside the model's
  bool fit_shape = true;        // false: the mean head (or the identity's) as it is
  int iterations = 8;           // of Gauss-Newton
  double robust_sigmas = 4;     // residuals beyond count less
  std::vector<int> outline;     // model points, beside those of the model
  double outline_yaw_deg = 10;  // weight exp(-(yaw / this)^2 / 2) of the outline's far side
  // Of the variance of each mode: what changes from frame to frame (expression) in one person, the
  // rest is identity.
  double expression_share = 0.05;
  // How much of what was learnt about the identity is kept per frame.
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

// What is known of one person's shape, from frames seen so far: a Gaussian of c = b / deviation in
// information form. Identity is constant, so each frame's normal equations (pose taken out by the
// Schur complement, expression added as noise) are summed up, older ones fading.
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
  // Of the rotation's error w, rad^2 (head/angle_sigma.h): the true rotation is exp([w]x) rotation.
  Eigen::Matrix3d turn_covariance = Eigen::Matrix3d::Zero();
  // Standard deviations of the angles' errors, up to 180.
  double yaw_sigma_deg = 0;
  double pitch_sigma_deg = 0;
  double roll_sigma_deg = 0;
  // Of yaw, pitch, roll: how much of these is the calibration's floor, the same for every image.
  Eigen::Vector3d sigma_floor_deg = Eigen::Vector3d::Zero();
};

// Sets the angles and their deviations to those of rotation and turn_covariance.
void set_angles(HeadPose& pose);
// Calibrates the covariance, and sets the angles.
void calibrate_sigmas(HeadPose& pose, const AngleCalibration& calibration);

// A pose, or why there is none.
struct HeadPoseResult {
  std::optional<HeadPose> pose;
  std::string reason;
};

class HeadPoser {
 public:
  // Throws std::invalid_argument for a model or options that do not pass their check.
  explicit HeadPoser(HeadModel model, HeadPoseOptions options = {});

  [[nodiscard]] const HeadModel& model() const { return model_; }
  [[nodiscard]] const HeadPoseOptions& options() const { return options_; }

  // points: 2 x n px in the order of the model's points; for another markup, with a
  // LandmarkMapping: the poser of select_points(model, mapping.model_points), and
  // landmarks(Eigen::all, mapping.landmarks). NaN
  // where missing, at least 6 not coplanar must be there. No pose: too few points, points that are
  // no head (the iteration leaves the space before the camera).
  // sigma_px: n, the distance from the truth that 68 % of such a point's measurements stay within
  // (landmarks/visibility.h), each above 0, so that hidden points count less; empty: not known.
  [[nodiscard]] HeadPoseResult pose(const Eigen::Matrix2Xd& points, const geometry::Camera& camera,
                                    const Eigen::VectorXd& sigma_px = {}) const;
  // The same with what earlier frames showed of the person, and learns from this one. A frame without
  // an answer leaves `identity` as it was.
  [[nodiscard]] HeadPoseResult pose(const Eigen::Matrix2Xd& points, const geometry::Camera& camera,
                                    HeadIdentity& identity,
                                    const Eigen::VectorXd& sigma_px = {}) const;

  // The pose that looks where `camera_from_head` looks: of its rotation only the direction of the
  // head's z axis counts, the turn about it, the translation and the shape are found. `identity`
  // may be null; it is not changed. The result's angles are those of the rotation found; its
  // covariance is that of the points alone, as if the direction were theirs.
  [[nodiscard]] HeadPoseResult pose_towards(const Eigen::Matrix2Xd& points,
                                            const geometry::Camera& camera,
                                            const Eigen::Matrix3d& camera_from_head,
                                            const HeadIdentity* identity = nullptr,
                                            const Eigen::VectorXd& sigma_px = {}) const;

  // Where the head's points are in the image, 2 x n px; NaN behind the camera.
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
  // Of points without outliers whose variance is `scale` times what is assumed: means of the robust
  // weight, of the squared influence of a residual and of the slope of that influence.
  struct RobustMeans {
    double weight = 1;
    double square = 1;
    double slope = 1;
  };
  [[nodiscard]] RobustMeans robust_means(double scale) const;
  // Of the turn, rad^2, from the normal equations of pose and shape, without the prior. strange:
  // squared residuals over their variances, where these are to be scaled by them; else empty.
  [[nodiscard]] Eigen::Matrix3d covariance_of(const Eigen::MatrixXd& normal,
                                              std::vector<double> strange, bool with_shape) const;
  RobustMeans robust_;
};

}  // namespace tarsier::face::head
