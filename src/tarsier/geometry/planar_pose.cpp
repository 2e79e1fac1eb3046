// SPDX-License-Identifier: MIT
#include "tarsier/geometry/planar_pose.h"

#include "tarsier/core/require.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/geometry/refine_pose.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

namespace tarsier::geometry {
namespace {

bool all_finite(std::span<const cv::Point2d> points) {
  return std::ranges::all_of(
      points, [](const cv::Point2d& p) { return std::isfinite(p.x) && std::isfinite(p.y); });
}

// Moves the centroid to the origin and scales the mean distance from it to sqrt(2).
struct Conditioning {
  Eigen::Vector2d center = Eigen::Vector2d::Zero();
  double scale = 1;
  [[nodiscard]] Eigen::Matrix3d matrix() const {
    Eigen::Matrix3d t;
    t << scale, 0, -scale * center.x(), 0, scale, -scale * center.y(), 0, 0, 1;
    return t;
  }
};

std::optional<Conditioning> conditioning_of(std::span<const cv::Point2d> points) {
  Conditioning c;
  for (const cv::Point2d& p : points) c.center += Eigen::Vector2d(p.x, p.y);
  c.center /= static_cast<double>(points.size());
  double mean = 0;
  for (const cv::Point2d& p : points) mean += (Eigen::Vector2d(p.x, p.y) - c.center).norm();
  mean /= static_cast<double>(points.size());
  if (!(mean > 0) || !std::isfinite(mean)) return std::nullopt;
  c.scale = std::sqrt(2.0) / mean;
  return c;
}

// In conditioned coordinates, from the normal equations of the algebraic error.
std::optional<Eigen::Matrix3d> conditioned_homography(std::span<const cv::Point2d> from,
                                                      std::span<const cv::Point2d> to,
                                                      const Conditioning& a,
                                                      const Conditioning& b) {
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    const double x = a.scale * (from[i].x - a.center.x());
    const double y = a.scale * (from[i].y - a.center.y());
    const double u = b.scale * (to[i].x - b.center.x());
    const double v = b.scale * (to[i].y - b.center.y());
    Eigen::Matrix<double, 2, 9> row;
    row << x, y, 1, 0, 0, 0, -u * x, -u * y, -u, 0, 0, 0, x, y, 1, -v * x, -v * y, -v;
    normal.noalias() += row.transpose() * row;
  }
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(normal);
  // Two directions without error: the points do not determine the map (too many are collinear).
  if (!(eigen.values(1) > 1e-12 * eigen.values(8))) return std::nullopt;
  const auto h = eigen.vectors.col(0);
  Eigen::Matrix3d m;
  m << h(0), h(1), h(2), h(3), h(4), h(5), h(6), h(7), h(8);
  return m;
}

std::optional<Eigen::Matrix3d> homography(std::span<const cv::Point2d> from,
                                          std::span<const cv::Point2d> to) {
  if (from.size() < 4 || !all_finite(from) || !all_finite(to)) return std::nullopt;
  const auto a = conditioning_of(from);
  const auto b = conditioning_of(to);
  if (!a || !b) return std::nullopt;
  const auto normalized_h = conditioned_homography(from, to, *a, *b);
  if (!normalized_h) return std::nullopt;
  // Points on lines are mapped to points on lines: then the map is singular.
  if (!(std::abs(normalized_h->determinant()) > 1e-9)) return std::nullopt;
  Eigen::Matrix3d h = b->matrix().inverse() * *normalized_h * a->matrix();
  h /= h.norm() * (h(2, 2) < 0 ? -1 : 1);
  return h;
}

// --- the points of one image ---

struct Problem {
  std::vector<Eigen::Vector2d> on_plane;  // relative to `center`
  std::vector<Eigen::Vector2d> rays;      // x / z, y / z
  Eigen::Vector2d center = Eigen::Vector2d::Zero();
  double fx = 1;
  double fy = 1;
  Eigen::MatrixXd information;  // of the pixels; empty: equal weights
};

std::optional<Problem> problem_of(std::span<const cv::Point2d> on_plane,
                                  std::span<const cv::Point2d> pixels, const Camera& camera,
                                  const PlanarPoseOptions& options) {
  TARSIER_REQUIRE(on_plane.size() == pixels.size(), "as many points on the plane as pixels");
  if (on_plane.size() < 4 || !all_finite(on_plane) || !all_finite(pixels)) return std::nullopt;
  Problem problem;
  problem.fx = camera.fx;
  problem.fy = camera.fy;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const auto ray = camera.normalized_of(pixels[i]);
    if (!ray) return std::nullopt;
    problem.rays.emplace_back(ray->x, ray->y);
    problem.on_plane.emplace_back(on_plane[i].x, on_plane[i].y);
    problem.center += problem.on_plane.back();
  }
  problem.center /= static_cast<double>(pixels.size());
  for (Eigen::Vector2d& p : problem.on_plane) p -= problem.center;
  if (!options.information.empty()) {
    const auto n = static_cast<Eigen::Index>(2 * pixels.size());
    TARSIER_REQUIRE(options.information.size() == static_cast<std::size_t>(n * n),
                    "an information matrix of {} numbers for {} points", options.information.size(),
                    pixels.size());
    problem.information = Eigen::Map<const Eigen::MatrixXd>(options.information.data(), n, n);
    if (!problem.information.allFinite()) return std::nullopt;
  }
  return problem;
}

struct Pose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  double cost = std::numeric_limits<double>::infinity();  // sum of squares, px^2
};

// px; empty if a point is not in front of the camera.
std::optional<Eigen::VectorXd> errors_of(const Problem& problem, const Pose& pose) {
  Eigen::VectorXd error(static_cast<Eigen::Index>(2 * problem.rays.size()));
  for (std::size_t i = 0; i < problem.rays.size(); ++i) {
    const Eigen::Vector2d& p = problem.on_plane[i];
    const Eigen::Vector3d x =
        pose.rotation.col(0) * p.x() + pose.rotation.col(1) * p.y() + pose.translation;
    if (!(x.z() > 0)) return std::nullopt;
    const auto at = static_cast<Eigen::Index>(2 * i);
    error[at] = problem.fx * (x.x() / x.z() - problem.rays[i].x());
    error[at + 1] = problem.fy * (x.y() / x.z() - problem.rays[i].y());
  }
  return error;
}

// Infinite if a point is not in front of the camera.
double cost_of(const Problem& problem, const Pose& pose) {
  const auto error = errors_of(problem, pose);
  if (!error) return std::numeric_limits<double>::infinity();
  return problem.information.size() > 0 ? error->dot(problem.information * *error)
                                        : error->squaredNorm();
}

// The two rotations whose first-order projection at the plane's origin equals that of the
// homography (Collins & Bartoli 2014, section 4). `h` has h(2, 2) = 1.
std::array<Eigen::Matrix3d, 2> rotations_of(const Eigen::Matrix3d& h) {
  const Eigen::Vector2d p(h(0, 2), h(1, 2));
  Eigen::Matrix2d jacobian;  // of the map at the origin
  jacobian << h(0, 0) - h(2, 0) * p.x(), h(0, 1) - h(2, 1) * p.x(), h(1, 0) - h(2, 0) * p.y(),
      h(1, 1) - h(2, 1) * p.y();
  // Rotates the optical axis to the line of sight to the origin. (Eigen's FromTwoVectors also
  // works, but compiles an SVD for opposite directions, which do not occur.)
  const Eigen::Vector3d ray = Eigen::Vector3d(p.x(), p.y(), 1).normalized();
  const double twice = std::sqrt(2 * (1 + ray.z()));  // twice the cosine of half the angle
  const Eigen::Matrix3d axis_to_ray =
      Eigen::Quaterniond(twice / 2, -ray.y() / twice, ray.x() / twice, 0).toRotationMatrix();
  const Eigen::Matrix2d b =
      axis_to_ray.topLeftCorner<2, 2>() - p * axis_to_ray.bottomLeftCorner<1, 2>();
  const Eigen::Matrix2d a = b.inverse() * jacobian;
  const double gamma = (std::hypot(a(0, 0) + a(1, 1), a(0, 1) - a(1, 0)) +
                        std::hypot(a(0, 0) - a(1, 1), a(0, 1) + a(1, 0))) /
                       2;  // the larger singular value
  // The rotation's upper left block, relative to the line of sight.
  const Eigen::Matrix2d upper = a / gamma;
  const Eigen::Matrix2d rest = Eigen::Matrix2d::Identity() - upper.transpose() * upper;
  Eigen::Vector2d lower(std::sqrt(std::max(0.0, rest(0, 0))), std::sqrt(std::max(0.0, rest(1, 1))));
  if (rest(0, 1) < 0) lower.y() = -lower.y();
  std::array<Eigen::Matrix3d, 2> rotations;
  for (int k = 0; k < 2; ++k) {
    Eigen::Matrix3d r;
    r.topLeftCorner<2, 2>() = upper;
    r.bottomLeftCorner<1, 2>() = (k == 0 ? lower : Eigen::Vector2d(-lower)).transpose();
    r.col(2) = r.col(0).cross(r.col(1));
    rotations[static_cast<std::size_t>(k)] = axis_to_ray * r;
  }
  return rotations;
}

// The translation with the minimum algebraic error: x - ray.x z = 0, y - ray.y z = 0.
Eigen::Vector3d translation_of(const Problem& problem, const Eigen::Matrix3d& rotation) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < problem.rays.size(); ++i) {
    const Eigen::Vector2d& p = problem.on_plane[i];
    const Eigen::Vector3d x = rotation.col(0) * p.x() + rotation.col(1) * p.y();
    Eigen::Matrix<double, 2, 3> a;
    a << 1, 0, -problem.rays[i].x(), 0, 1, -problem.rays[i].y();
    normal.noalias() += a.transpose() * a;
    right.noalias() -= a.transpose() * (a * x);
  }
  return linalg::solve_symmetric(normal, right);
}

// Linearises the residuals for a small rotation w (R <- exp([w]x) R) and a change of t.
PoseEquations linearized(const Problem& problem, const Pose& pose) {
  const auto rows = static_cast<Eigen::Index>(2 * problem.rays.size());
  Eigen::Matrix<double, Eigen::Dynamic, 6> jacobian(rows, 6);
  Eigen::VectorXd error(rows);
  for (std::size_t i = 0; i < problem.rays.size(); ++i) {
    const Eigen::Vector2d& p = problem.on_plane[i];
    const Eigen::Vector3d turned = pose.rotation.col(0) * p.x() + pose.rotation.col(1) * p.y();
    const Eigen::Vector3d x = turned + pose.translation;
    const double inverse = 1 / x.z();
    Eigen::Matrix<double, 2, 3> pixel_by_point;
    pixel_by_point << problem.fx * inverse, 0, -problem.fx * x.x() * inverse * inverse, 0,
        problem.fy * inverse, -problem.fy * x.y() * inverse * inverse;
    Eigen::Matrix3d point_by_rotation;  // -[turned]x
    point_by_rotation << 0, turned.z(), -turned.y(), -turned.z(), 0, turned.x(), turned.y(),
        -turned.x(), 0;
    const auto at = static_cast<Eigen::Index>(2 * i);
    jacobian.middleRows<2>(at) << pixel_by_point * point_by_rotation, pixel_by_point;
    error[at] = problem.fx * (x.x() * inverse - problem.rays[i].x());
    error[at + 1] = problem.fy * (x.y() * inverse - problem.rays[i].y());
  }
  PoseEquations linear;
  if (problem.information.size() > 0) {
    const Eigen::Matrix<double, Eigen::Dynamic, 6> weighted = problem.information * jacobian;
    linear.normal.noalias() = jacobian.transpose() * weighted;
    linear.gradient.noalias() = weighted.transpose() * error;
  } else {
    linear.normal.noalias() = jacobian.transpose() * jacobian;
    linear.gradient.noalias() = jacobian.transpose() * error;
  }
  return linear;
}

void refine(const Problem& problem, int iterations, Pose& pose) {
  const auto cost = [&](const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation) {
    return cost_of(problem, {rotation, translation});
  };
  const auto equations = [&](const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation) {
    return linearized(problem, {rotation, translation});
  };
  // Damped from the start: a full first step may move to the other of the two minima.
  const RefinePoseOptions how{
      .max_steps = iterations, .max_trials = iterations, .damping = 1e-4, .tolerance = 1e-10};
  pose.cost = refine_pose(pose.rotation, pose.translation, cost, equations, how).cost;
}

PlanarPose to_planar_pose(const Problem& problem, const Pose& pose) {
  PlanarPose result;
  result.camera_from_plane = {pose.rotation,
                              pose.translation - pose.rotation.leftCols<2>() * problem.center};
  const auto points = static_cast<double>(problem.rays.size());
  result.misfit = std::sqrt(pose.cost / points);
  result.rms_px = result.misfit;
  if (problem.information.size() > 0) {
    if (const auto error = errors_of(problem, pose))
      result.rms_px = std::sqrt(error->squaredNorm() / points);
  }
  return result;
}

bool are_equal(const Pose& a, const Pose& b) {
  const double trace = (a.rotation.transpose() * b.rotation).trace();
  return trace > 3 - 1e-6;  // a twentieth of a degree
}

}  // namespace

double PlanarPoses::ambiguity_ratio() const {
  if (!other) return std::numeric_limits<double>::infinity();
  return other->misfit / std::max(best.misfit, 1e-9);
}

void PlanarPoseOptions::check() const {
  TARSIER_REQUIRE(iterations >= 0 && iterations <= 1000, "iterations in 0..1000");
}

std::optional<cv::Matx33d> homography_of(std::span<const cv::Point2d> from,
                                         std::span<const cv::Point2d> to) {
  TARSIER_REQUIRE(from.size() == to.size(), "as many points on both sides");
  const auto h = homography(from, to);
  if (!h) return std::nullopt;
  return to_cv(*h);
}

std::optional<PlanarPoses> planar_poses(std::span<const cv::Point2d> on_plane,
                                        std::span<const cv::Point2d> pixels, const Camera& camera,
                                        const PlanarPoseOptions& options) {
  options.check();
  const auto problem = problem_of(on_plane, pixels, camera, options);
  if (!problem) return std::nullopt;
  std::vector<cv::Point2d> plane;
  std::vector<cv::Point2d> rays;
  for (std::size_t i = 0; i < problem->rays.size(); ++i) {
    plane.emplace_back(problem->on_plane[i].x(), problem->on_plane[i].y());
    rays.emplace_back(problem->rays[i].x(), problem->rays[i].y());
  }
  auto h = homography(plane, rays);
  if (!h || !(std::abs((*h)(2, 2)) > 1e-9)) return std::nullopt;
  *h /= (*h)(2, 2);

  std::array<Pose, 2> poses;
  const auto rotations = rotations_of(*h);
  for (std::size_t k = 0; k < 2; ++k) {
    if (!rotations[k].allFinite()) continue;
    poses[k].rotation = rotations[k];
    poses[k].translation = translation_of(*problem, rotations[k]);
    refine(*problem, options.iterations, poses[k]);
  }
  if (poses[1].cost < poses[0].cost) std::swap(poses[0], poses[1]);
  if (!std::isfinite(poses[0].cost)) return std::nullopt;
  PlanarPoses result;
  result.best = to_planar_pose(*problem, poses[0]);
  if (std::isfinite(poses[1].cost) && !are_equal(poses[0], poses[1]))
    result.other = to_planar_pose(*problem, poses[1]);
  return result;
}

}  // namespace tarsier::geometry
