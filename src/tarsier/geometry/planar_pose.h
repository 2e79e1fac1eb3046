// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <opencv2/core.hpp>

#include <optional>
#include <span>
#include <vector>

// Where a planar object of known size is, from one image.
namespace tarsier::geometry {

// The matrix H, with |H| = 1 and H(2, 2) >= 0, that minimises the algebraic error of to ~ H from,
// after both sides were centred and scaled (Hartley, "In defence of the eight-point algorithm",
// 1997). Empty for fewer than 4 points, numbers that are not finite, or points of which too many
// lie on one line. Throws std::invalid_argument for lists of different lengths.
[[nodiscard]] std::optional<cv::Matx33d> homography_of(std::span<const cv::Point2d> from,
                                                       std::span<const cv::Point2d> to);

// (u, v) = H (x, y, 1), divided by its third component.
[[nodiscard]] inline cv::Point2d mapped(const cv::Matx33d& h, const cv::Point2d& p) {
  const cv::Vec3d q = h * cv::Vec3d(p.x, p.y, 1);
  return {q[0] / q[2], q[1] / q[2]};
}

struct PlanarPose {
  Rigid3 camera_from_plane;  // unit of the points on the plane
  double rms_px = 0;         // root of the mean squared distance of the projected points
  double misfit = 0;         // what is minimised: rms_px, or with `information` in its unit
};

// A plane seen with little perspective has two poses that explain it nearly alike, mirrored about
// the line of sight.
struct PlanarPoses {
  PlanarPose best;                  // the one that explains the points better
  std::optional<PlanarPose> other;  // the second minimum, if it is one
  // How much worse the other is: its misfit over the best one's; infinite where there is no other.
  // Near 1 this image does not decide between the two.
  [[nodiscard]] double ambiguity_ratio() const;
};

struct PlanarPoseOptions {
  int iterations = 12;  // of Levenberg-Marquardt, for each of the two; 0..1000
  // How surely the pixels' coordinates are known: the inverse of their covariance (px^-2), a
  // symmetric 2n x 2n matrix over (u0, v0, u1, v1, ..), row by row; empty: all alike. The pose then
  // minimises e' W e; the misfit is the root of its mean over the points, in standard deviations.
  std::vector<double> information;
  void check() const;
};

// Both poses from at least 4 points (x, y, z = 0) and their pixels: the local affinity of the
// homography gives two rotations in closed form (IPPE: Collins & Bartoli, "Infinitesimal
// plane-based pose estimation", IJCV 2014), a linear system each translation; then each is refined
// to the least squared distance in pixels, in the image that the camera would take without
// distortion. The points lie before the camera in both. Empty where the points or pixels have no
// homography, a pixel has no ray, or no pose puts all points before the camera. Throws
// std::invalid_argument for lists of different lengths.
[[nodiscard]] std::optional<PlanarPoses> planar_poses(std::span<const cv::Point2d> on_plane,
                                                      std::span<const cv::Point2d> pixels,
                                                      const Camera& camera,
                                                      const PlanarPoseOptions& options = {});

// Refines a pose that is nearly right, e.g. that of the last frame; empty as above.
[[nodiscard]] std::optional<PlanarPose> refine_planar_pose(const Rigid3& start,
                                                           std::span<const cv::Point2d> on_plane,
                                                           std::span<const cv::Point2d> pixels,
                                                           const Camera& camera,
                                                           const PlanarPoseOptions& options = {});

}  // namespace tarsier::geometry
