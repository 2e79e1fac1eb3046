// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/pair_agreement.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/geometry/epipolar.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace tarsier::sfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kMaxRotation = 3 * kRadiansPerDegree;
constexpr double kMaxDirectionError = 15 * kRadiansPerDegree;
constexpr double kMinRayAngle = 2 * kRadiansPerDegree;
constexpr double kMinPlaneShare = 0.7;  // share of the inliers
// px, between a feature and the mapped position of its match
constexpr double kMaxPlaneErrorPx = 4;
constexpr int kReweightings = 8;                 // of reweighted least squares
constexpr double kMinPlaneExplainedShare = 0.9;  // share of the inliers
constexpr double kMaxEpipolarErrorPx = 2;
constexpr double kMinSquaredSine = 1e-6;  // min squared sine of rays that determine a depth

// The inliers of a pair in normalised coordinates.
struct Rays {
  std::vector<Vector3d> first;
  std::vector<Vector2d> second;
};

Rays rays_of(const Model& model, const Pair& pair) {
  const Image& first = model.images[at(pair.first)];
  const Image& second = model.images[at(pair.second)];
  Rays rays;
  for (const Match& match : pair.view.inliers) {
    const auto a =
        model.cameras[at(first.camera)].normalized_of(cv::Point2d(first.features[at(match.first)]));
    const auto b = model.cameras[at(second.camera)].normalized_of(
        cv::Point2d(second.features[at(match.second)]));
    if (!a || !b) continue;
    rays.first.emplace_back(a->x, a->y, 1);
    rays.second.emplace_back(b->x, b->y);
  }
  return rays;
}

bool is_of_one_plane(const Pair& pair) {
  return !pair.view.inliers.empty() &&
         pair.view.homography_inliers >=
             kMinPlaneShare * static_cast<double>(pair.view.inliers.size());
}

double threshold_of(const geometry::Camera& camera) {
  return kMaxPlaneErrorPx / ((camera.fx + camera.fy) / 2);
}

// The plane n by weighted least squares: the action of H = R + t n' on the rays is linear in n.
Vector3d fit_plane(const Rays& rays, const geometry::Rigid3& motion,
                   const std::vector<double>& weights) {
  Matrix3d normal = 1e-12 * Matrix3d::Identity();
  Vector3d right = Vector3d::Zero();
  const Vector3d& t = motion.translation;
  for (std::size_t i = 0; i < rays.first.size(); ++i) {
    const Vector3d turned = motion.rotation * rays.first[i];
    for (int k = 0; k < 2; ++k) {
      const double factor = rays.second[i][k] * t[2] - t[k];
      const double target = turned[k] - rays.second[i][k] * turned[2];
      normal += weights[i] * factor * factor * rays.first[i] * rays.first[i].transpose();
      right += weights[i] * factor * target * rays.first[i];
    }
  }
  return normal.ldlt().solve(right);
}

// Share of a pair's inliers that lie on one plane, with this relative pose.
double share_on_plane(const Rays& rays, geometry::Rigid3 motion, double threshold) {
  const double length = motion.translation.norm();
  if (length > 0) motion.translation /= length;
  std::vector<double> weights(rays.first.size(), 1);
  int best = 0;
  for (int round = 0; round < kReweightings; ++round) {
    const Vector3d plane = fit_plane(rays, motion, weights);
    int inliers = 0;
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const Vector3d point =
          motion.rotation * rays.first[i] + motion.translation * plane.dot(rays.first[i]);
      weights[i] = 0;
      if (!(point[2] > 0)) continue;
      const double error = (point.head<2>() / point[2] - rays.second[i]).norm() / threshold;
      if (error < 1) ++inliers;
      // Weights for the error in the image instead of the algebraic error; Geman and McClure's
      // loss.
      weights[i] = 1 / (point[2] * point[2] * (1 + error * error) * (1 + error * error));
    }
    best = std::max(best, inliers);
  }
  return best / std::max(1.0, static_cast<double>(weights.size()));
}

// Whether the point of two rays is in front of both cameras: x2 b = x1 R a + t.
bool is_in_front(const geometry::Rigid3& motion, const Vector3d& first, const Vector3d& second) {
  const Vector3d turned = motion.rotation * first;
  const Vector3d across = turned.cross(second);
  if (across.squaredNorm() < kMinSquaredSine * turned.squaredNorm() * second.squaredNorm())
    return turned.dot(second) > 0;  // far away
  return motion.translation.cross(second).dot(across) < 0 &&
         motion.translation.cross(turned).dot(across) < 0;
}

}  // namespace

std::size_t explained_matches(const Model& model, const Pair& pair, double threshold_px) {
  const geometry::Camera& first = model.cameras[at(model.images[at(pair.first)].camera)];
  const geometry::Camera& second = model.cameras[at(model.images[at(pair.second)].camera)];
  const geometry::Rigid3 motion =
      model.images[at(pair.second)].pose * model.images[at(pair.first)].pose.inverse();
  const Matrix3d essential = geometry::essential_of(motion);
  const double threshold = threshold_px * 4 / (first.fx + first.fy + second.fx + second.fy);
  const Rays rays = rays_of(model, pair);
  std::size_t count = 0;
  for (std::size_t i = 0; i < rays.first.size(); ++i) {
    const Vector3d& a = rays.first[i];
    const Vector3d b = rays.second[i].homogeneous();
    const Vector3d line = essential * a;
    const Vector3d back = essential.transpose() * b;
    const double slope = line.head<2>().squaredNorm() + back.head<2>().squaredNorm();
    const double error = b.dot(line);
    if (slope > 0 && error * error <= threshold * threshold * slope && is_in_front(motion, a, b))
      ++count;
  }
  return count;
}

bool is_registered(const Model& model, const Pair& pair) {
  return !pair.view.inliers.empty() && model.images[at(pair.first)].registered &&
         model.images[at(pair.second)].registered;
}

bool agrees(const Model& model, const Pair& pair) {
  const geometry::Rigid3 relative =
      model.images[at(pair.second)].pose * model.images[at(pair.first)].pose.inverse();
  const geometry::Rigid3& found = pair.view.second_from_first;
  if (geometry::angle_of(relative.rotation * found.rotation.transpose()) <= kMaxRotation) {
    const double lengths = relative.translation.norm() * found.translation.norm();
    if (pair.view.median_angle < kMinRayAngle || !(lengths > 0)) return true;
    if (relative.translation.dot(found.translation) >= std::cos(kMaxDirectionError) * lengths)
      return true;
  }
  const std::size_t explained = explained_matches(model, pair, kMaxEpipolarErrorPx);
  if (explained > 0 && static_cast<double>(explained) >=
                           kMinPlaneExplainedShare * static_cast<double>(pair.view.inliers.size()))
    return true;
  if (!is_of_one_plane(pair)) return false;
  const double threshold = threshold_of(model.cameras[at(model.images[at(pair.second)].camera)]);
  return share_on_plane(rays_of(model, pair), relative, threshold) >= kMinPlaneShare;
}

}  // namespace tarsier::sfm
