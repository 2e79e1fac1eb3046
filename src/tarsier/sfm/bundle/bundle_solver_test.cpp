// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/bundle_solver.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/geometry/camera.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <numeric>
#include <vector>

namespace tarsier::sfm {
namespace {

geometry::Rigid3 turned(const geometry::Rigid3& pose, int axis, double angle) {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  const int a = (axis + 1) % 3;
  const int b = (axis + 2) % 3;
  turn(a, a) = turn(b, b) = std::cos(angle);
  turn(b, a) = std::sin(angle);
  turn(a, b) = -std::sin(angle);
  return {turn * pose.rotation, pose.translation};
}

geometry::Camera camera_of(const LensParameters& lens) {
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = lens[0];
  camera.fy = lens[0] * lens[1];
  camera.cx = lens[2];
  camera.cy = lens[3];
  for (std::size_t k = 0; k < 5; ++k) camera.distortion[k] = lens[4 + k];
  return camera;
}

// The sum that solve() minimises, computed with the library's camera.
double sum_of(const BundleProblem& problem) {
  const double c2 = problem.loss_px * problem.loss_px;
  double sum = 0;
  for (std::size_t p = 0; p < problem.points.size(); ++p) {
    for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
      const BundleProblem::Measurement& seen = problem.measurements[k];
      const auto pixel = camera_of(problem.lenses[at(seen.lens)])
                             .project(problem.poses[at(seen.pose)] * problem.points[p]);
      if (!pixel) return std::nan("");
      const cv::Point2d residual = seen.weight * (*pixel - cv::Point2d(seen.u, seen.v));
      sum += c2 > 0 ? c2 * std::log1p(residual.dot(residual) / c2) : residual.dot(residual);
    }
  }
  if (problem.prior) {
    const BundleProblem::CenterPrior& prior = *problem.prior;
    const double residual =
        prior.weight * (problem.poses[at(prior.pose)].center()[prior.axis] - prior.value);
    sum += residual * residual;
  }
  return sum / 2;
}

// Cameras in a row in front of a cloud, `spacing` apart. Observations have noise, and every tenth
// is a far outlier. The start is not the truth. The first camera is fixed. Every camera observes
// the points within 1.5 along the row.
BundleProblem some_problem(int cameras, int points, double noise, bool free_lens,
                           double spacing = 0.5) {
  Rng rng(4);
  BundleProblem problem;
  problem.loss_px = 0.5;
  problem.lenses = {{500, 1.01, 320, 240, -0.1, 0.02, 0.001, -0.002, 0.003},
                    {520, 0.99, 318, 242, 0.05, -0.01, 0, 0.001, 0}};
  const std::vector<LensParameters> truth = problem.lenses;
  std::vector<geometry::Rigid3> poses;
  for (int i = 0; i < cameras; ++i) {
    geometry::Rigid3 pose;
    pose.translation = {-spacing * i, 0.1 * (i % 3), 5};
    poses.push_back(turned(pose, i % 3, 0.05));
  }
  for (int p = 0; p < points; ++p) {
    const double x = spacing * (cameras - 1) * rng.uniform();
    const double y = rng.uniform() - 0.5;
    const double z = rng.uniform() - 0.5;
    const Eigen::Vector3d position(x, 2 * y, 2 * z);
    problem.first.push_back(problem.measurements.size());
    for (int i = 0; i < cameras; ++i) {
      if (std::abs(spacing * i - x) > 1.5) continue;
      const auto pixel = camera_of(truth[at(i % 2)]).project(poses[at(i)] * position);
      const double sigma = problem.measurements.size() % 10 == 9 ? 20 : noise;
      const double u = pixel->x + rng.normal(0, sigma);
      const double v = pixel->y + rng.normal(0, sigma);
      problem.measurements.push_back({i, i % 2, u, v, 1 - 0.1 * (i % 4)});
    }
    Eigen::Vector3d start = position;
    for (int k = 0; k < 3; ++k) start[k] += rng.normal(0, 0.01);
    problem.points.push_back(start);
  }
  problem.first.push_back(problem.measurements.size());
  problem.point_moves.assign(problem.points.size(), 1);
  problem.point_moves[3] = 0;
  problem.poses = poses;
  problem.pose_moves.assign(poses.size(), 1);
  problem.pose_moves[0] = 0;
  for (std::size_t i = 1; i < poses.size(); ++i)
    for (int k = 0; k < 3; ++k) problem.poses[i].translation[k] += rng.normal(0, 0.003);
  problem.prior = {cameras - 1, 0, poses.back().center()[0], 1e3};
  if (free_lens) problem.free_parameters = {0, 2, 3, 4, 5, 6, 7};
  return problem;
}

BundleSolverOptions exact() {
  BundleSolverOptions options;
  options.tolerance = 1e-12;
  options.max_iterations = 200;
  return options;
}

// The equations move a point that is much too far away behind its cameras.
TEST(BundleSolver, ConvergesDespiteOvershootingPoints) {
  BundleProblem unperturbed = some_problem(12, 200, 0.3, false);
  BundleProblem perturbed = unperturbed;
  for (const std::size_t p : {20U, 90U, 150U}) {
    const Eigen::Vector3d center =
        perturbed.poses[at(perturbed.measurements[perturbed.first[p]].pose)].center();
    perturbed.points[p] = center + 40 * (perturbed.points[p] - center);
  }
  BundleSolverOptions options;
  options.max_iterations = 12;
  const BundleSolution from_unperturbed = solve(unperturbed, options);
  const BundleSolution from_perturbed = solve(perturbed, options);
  EXPECT_NEAR(from_perturbed.cost_after, from_unperturbed.cost_after,
              1e-3 * from_unperturbed.cost_after);
}

// Central differences of the sum, by code that is independent of the solver's derivatives.
TEST(BundleSolver, FindsLocalMinimum) {
  for (const bool free_lens : {false, true}) {
    BundleProblem problem = some_problem(6, 60, 0.5, free_lens);
    const double before = sum_of(problem);
    const BundleSolution solution = solve(problem, exact());
    ASSERT_EQ(solution.error, "");
    EXPECT_NEAR(solution.cost_before, before, 1e-9 * before);
    EXPECT_NEAR(solution.cost_after, sum_of(problem), 1e-9 * before);
    EXPECT_LT(solution.cost_after, 0.6 * before);
    const auto derivative = [&](auto&& change, double by) {
      BundleProblem more = problem;
      BundleProblem less = problem;
      change(more, by);
      change(less, -by);
      return (sum_of(more) - sum_of(less)) / 2;
    };
    // Steps that move pixels by about a hundredth.
    for (std::size_t i = 1; i < problem.poses.size(); ++i) {
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(
            derivative([&](BundleProblem& p, double by) { p.poses[i].translation[k] += by; }, 1e-4),
            0, 1e-3);
        EXPECT_NEAR(
            derivative([&](BundleProblem& p, double by) { p.poses[i] = turned(p.poses[i], k, by); },
                       2e-5),
            0, 1e-3);
      }
    }
    for (std::size_t p = 0; p < problem.points.size(); ++p) {
      if (problem.point_moves[p] == 0) continue;
      for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(derivative([&](BundleProblem& q, double by) { q.points[p][k] += by; }, 1e-4), 0,
                    1e-3);
    }
    for (std::size_t l = 0; l < problem.lenses.size(); ++l)
      for (const int k : problem.free_parameters)
        EXPECT_NEAR(derivative([&](BundleProblem& p, double by) { p.lenses[l][at(k)] += by; },
                               k < 4 ? 1e-2 : 1e-4),
                    0, 1e-3);
  }
}

TEST(BundleSolver, LeavesFixedVariablesUnchanged) {
  BundleProblem problem = some_problem(5, 40, 0.3, true);
  const BundleProblem before = problem;
  ASSERT_EQ(solve(problem, {}).error, "");
  EXPECT_EQ(problem.poses[0].translation, before.poses[0].translation);
  EXPECT_EQ(problem.poses[0].rotation, before.poses[0].rotation);
  EXPECT_NE(problem.poses[1].translation, before.poses[1].translation);
  EXPECT_EQ(problem.points[3], before.points[3]);
  EXPECT_NE(problem.points[4], before.points[4]);
  for (const std::size_t number : {1U, 8U})
    EXPECT_EQ(problem.lenses[1][number], before.lenses[1][number]);
  EXPECT_NE(problem.lenses[1][0], before.lenses[1][0]);
}

TEST(BundleSolver, DenseAndSparseSystemsAgree) {
  for (const bool free_lens : {false, true}) {
    BundleProblem dense = some_problem(20, 200, 0.4, free_lens);
    BundleProblem sparse = dense;
    BundleSolverOptions options = exact();
    options.system = CameraSystem::kDense;
    const BundleSolution one = solve(dense, options);
    options.system = CameraSystem::kSparse;
    const BundleSolution other = solve(sparse, options);
    EXPECT_NEAR(one.cost_after, other.cost_after, 1e-8 * one.cost_after);
    for (std::size_t i = 0; i < dense.poses.size(); ++i)
      EXPECT_LT((dense.poses[i].translation - sparse.poses[i].translation).norm(), 1e-3);
  }
}

// Many cameras with nearly the same view. Where possible, the sparse equations are solved with the
// factor of an earlier step.
TEST(BundleSolver, DenseAndSparseSystemsAgreeForNearlySameViews) {
  BundleProblem dense = some_problem(240, 50, 0.4, false, 0.01);
  BundleProblem sparse = dense;
  BundleSolverOptions options;
  options.tolerance = 1e-8;
  options.system = CameraSystem::kDense;
  const BundleSolution one = solve(dense, options);
  options.system = CameraSystem::kSparse;
  const BundleSolution other = solve(sparse, options);
  EXPECT_LT(one.cost_after, 0.9 * one.cost_before);
  EXPECT_NEAR(one.cost_after, other.cost_after, 1e-5 * one.cost_after);
}

// 80 poses fill five stripes of the equations; the last stripe also has the lenses.
TEST(BundleSolver, ResultDoesNotDependOnNumberOfThreads) {
  for (const bool free_lens : {false, true}) {
    const BundleProblem given = some_problem(80, 1200, 0.5, free_lens);
    const int before = cv::getNumThreads();
    std::vector<BundleProblem> solved(2, given);
    cv::setNumThreads(1);
    const BundleSolution one = solve(solved[0], exact());
    cv::setNumThreads(3);
    const BundleSolution several = solve(solved[1], exact());
    cv::setNumThreads(before);
    EXPECT_LT(one.cost_after, one.cost_before);
    EXPECT_EQ(one.cost_after, several.cost_after);
    for (std::size_t i = 0; i < given.poses.size(); ++i)
      EXPECT_EQ(solved[0].poses[i].translation, solved[1].poses[i].translation);
    EXPECT_EQ(solved[0].points, solved[1].points);
    EXPECT_EQ(solved[0].lenses, solved[1].lenses);
  }
}

// If the second derivatives leave out those of the loss, each step goes only half of the way. Then
// more than three times as many steps are needed.
TEST(BundleSolver, NeedsFewIterationsForResidualsOfLossScale) {
  BundleProblem problem = some_problem(12, 150, 0.5, false);
  BundleSolverOptions options;
  options.tolerance = 1e-9;
  options.max_iterations = 200;
  const BundleSolution solution = solve(problem, options);
  EXPECT_LT(solution.iterations, 25);
}

// A ring of cameras that look at a wall inside it. At the start the ring is bent, but neighbours
// nearly agree. With R and t as the unknowns of a pose, the search ends 11 % above the minimum.
TEST(BundleSolver, StraightensBentCameraRing) {
  constexpr int kCameras = 240;
  constexpr double kRadius = 100;
  constexpr double kBend = 0.002;
  Rng rng(9);
  BundleProblem problem;
  problem.loss_px = 0.5;
  problem.lenses = {{500, 1, 320, 240, 0, 0, 0, 0, 0}};
  const auto around = [](double angle, double radius, double height) {
    return Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), height);
  };
  std::vector<geometry::Rigid3> truth;
  for (int i = 0; i < kCameras; ++i) {
    const double angle = 2 * CV_PI * i / kCameras;
    geometry::Rigid3 pose;
    pose.rotation.row(2) = -around(angle, 1, 0);
    pose.rotation.row(1) = Eigen::RowVector3d(0, 0, -1);
    pose.rotation.row(0) = Eigen::RowVector3d(-std::sin(angle), std::cos(angle), 0);
    pose.translation = -(pose.rotation * around(angle, kRadius, 0));
    truth.push_back(pose);
  }
  for (int p = 0; p < 12 * kCameras; ++p) {
    const Eigen::Vector3d position =
        around(2 * CV_PI * rng.uniform(), 0.9 * kRadius + 2 * rng.uniform(), 6 * rng.uniform() - 3);
    const std::size_t first = problem.measurements.size();
    for (int i = 0; i < kCameras; ++i) {
      if ((truth[at(i)].center() - position).norm() > 20) continue;
      const auto pixel = camera_of(problem.lenses[0]).project(truth[at(i)] * position);
      if (!pixel || std::abs(pixel->x - 320) > 320 || std::abs(pixel->y - 240) > 240) continue;
      problem.measurements.push_back(
          {i, 0, pixel->x + rng.normal(0, 0.5), pixel->y + rng.normal(0, 0.5), 1});
    }
    if (problem.measurements.size() < first + 2) {
      problem.measurements.resize(first);
      continue;
    }
    problem.first.push_back(first);
    problem.points.push_back(position);
  }
  problem.first.push_back(problem.measurements.size());
  problem.point_moves.assign(problem.points.size(), 1);
  problem.pose_moves.assign(truth.size(), 1);
  problem.pose_moves[0] = 0;
  problem.prior = {kCameras / 2, 0, truth[kCameras / 2].center()[0], 1e3};
  problem.poses = truth;
  BundleProblem bent = problem;
  const double best = solve(problem, exact()).cost_after;
  // Along the ring, cameras are first rotated too much, then too little.
  std::vector<geometry::Rigid3> bend(truth.size());
  for (int i = 1; i < kCameras; ++i) {
    const Eigen::Vector3d center = truth[at(i)].center();
    const double angle = kBend * std::cos(4 * CV_PI * i / kCameras);
    const Eigen::Matrix3d turn = geometry::rotation_by(Eigen::Vector3d(0, 0, angle));
    bend[at(i)] = bend[at(i - 1)] * geometry::Rigid3{turn, center - turn * center};
    bent.poses[at(i)] = truth[at(i)] * bend[at(i)].inverse();
  }
  for (Eigen::Vector3d& point : bent.points) {
    const double angle = std::atan2(point.y(), point.x());
    const int nearest = static_cast<int>(std::lround(angle * kCameras / (2 * CV_PI)));
    point = bend[at((nearest + kCameras) % kCameras)] * point;
  }
  bent.prior->value = bent.poses[kCameras / 2].center()[0];
  const BundleSolution solution = solve(bent, {});
  EXPECT_EQ(solution.error, "");
  EXPECT_LT(solution.cost_after, 1.002 * best);
}

TEST(BundleSolver, ReportsPointBehindCamera) {
  BundleProblem problem = some_problem(5, 40, 0.3, false);
  problem.points[7][2] = -20;
  const BundleProblem before = problem;
  EXPECT_NE(solve(problem, {}).error, "");
  EXPECT_EQ(problem.points[8], before.points[8]);
}

TEST(BundleSolver, InterruptionLeavesProblemUnchanged) {
  BundleProblem problem = some_problem(5, 40, 0.3, false);
  const BundleProblem before = problem;
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)solve(problem, {}, stop.get_token()), Interrupted);
  EXPECT_EQ(problem.points[8], before.points[8]);
  EXPECT_EQ(problem.poses[2].translation, before.poses[2].translation);
}

}  // namespace
}  // namespace tarsier::sfm
