// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <opencv2/core.hpp>

#include <optional>
#include <span>
#include <vector>

// The pose of a planar object of known size, from one image.
namespace tarsier::geometry {

// The matrix H, with |H| = 1 and H(2, 2) >= 0, that minimises the algebraic error of to ~ H from
// after centring and scaling both sides (Hartley, "In defence of the eight-point algorithm", 1997).
// Empty for fewer than 4 points, non-finite numbers, or too many collinear points. Throws
// std::invalid_argument for lists of different lengths.
[[nodiscard]] std::optional<cv::Matx33d> homography_of(std::span<const cv::Point2d> from,
                                                       std::span<const cv::Point2d> to);

// (u, v) = H (x, y, 1), divided by its third component.
[[nodiscard]] inline cv::Point2d mapped(const cv::Matx33d& h, const cv::Point2d& p) {
  const cv::Vec3d q = h * cv::Vec3d(p.x, p.y, 1);
  return {q[0] / q[2], q[1] / q[2]};
}

struct PlanarPose {
  Rigid3 camera_from_plane;  // in the unit of the points on the plane
  double rms_px = 0;         // root mean square reprojection error
  double misfit = 0;         // the minimised error: rms_px, or with `information` in its unit
};

// A plane seen with little perspective has two poses with nearly the same error, mirrored about the
// line of sight.
struct PlanarPoses {
  PlanarPose best;                  // the pose with the smaller error
  std::optional<PlanarPose> other;  // the second local minimum, if it exists
  // The misfit of the other pose divided by that of the best; infinite if there is no other. Near
  // 1, this image does not distinguish the two poses.
  [[nodiscard]] double ambiguity_ratio() const;
};

struct PlanarPoseOptions {
  int iterations = 12;  // of Levenberg-Marquardt, for each pose; 0..1000
  // The inverse covariance of the pixel coordinates (px^-2): a symmetric 2n x 2n matrix over (u0,
  // v0, u1, v1, ..), row by row; empty: equal weights. The pose then minimises e' W e, and the
  // misfit is the root of its mean over the points, in standard deviations.
  std::vector<double> information;
  void check() const;
};

// Estimates both poses from at least 4 points (x, y, z = 0) and their pixels. The local affinity of
// the homography gives two rotations in closed form (IPPE: Collins & Bartoli, "Infinitesimal
// plane-based pose estimation", IJCV 2014), and a linear system gives each translation. Each pose
// is then refined to the minimum squared reprojection error in the undistorted image. All points
// are in front of the camera in both poses. Empty if the points or pixels have no homography, a
// pixel has no ray, or no pose has all points in front of the camera. Throws std::invalid_argument
// for lists of different lengths.
[[nodiscard]] std::optional<PlanarPoses> planar_poses(std::span<const cv::Point2d> on_plane,
                                                      std::span<const cv::Point2d> pixels,
                                                      const Camera& camera,
                                                      const PlanarPoseOptions& options = {});

}  // namespace tarsier::geometry
