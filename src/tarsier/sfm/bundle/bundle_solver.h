// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// The parameters of a lens: f, the ratio fy / fx, cx, cy, k1, k2, p1, p2, k3.
using LensParameters = std::array<double, 9>;

// A bundle adjustment problem: find poses, points and lenses that minimise
//
//   1/2 sum over observations of rho(s),  s = |w (pi(R X + t) - u)|^2,
//   rho(s) = c^2 log(1 + s / c^2)
//
// with the pinhole projection pi with OpenCV's distortion, the observation's weight w, and c =
// loss_px (Cauchy's loss; 0: squared loss).
struct BundleProblem {
  struct Measurement {
    int pose = 0;
    int lens = 0;
    double u = 0;  // px
    double v = 0;
    double weight = 1;
  };
  // Pulls one coordinate of a moving camera's centre to a value, as a residual.
  struct CenterPrior {
    int pose = 0;
    int axis = 0;
    double value = 0;
    double weight = 1;
  };
  std::vector<geometry::Rigid3> poses;  // camera_from_world
  std::vector<char> pose_moves;         // for each pose
  std::vector<LensParameters> lenses;
  // parameters that are refined in every moving lens, ascending; empty: lenses are fixed
  std::vector<int> free_parameters;
  std::vector<char> lens_moves;         // for each lens; empty: all move
  std::vector<Eigen::Vector3d> points;  // world
  std::vector<char> point_moves;        // for each point
  // The observations ordered by point: those of point p are measurements[first[p]] to
  // measurements[first[p + 1] - 1].
  std::vector<std::size_t> first;
  std::vector<Measurement> measurements;
  std::optional<CenterPrior> prior;
  double loss_px = 0;
};

// Solver for the equations of poses and lenses.
enum class CameraSystem { kAutomatic, kDense, kSparse };

struct BundleSolverOptions {
  int max_iterations = 50;
  double tolerance = 1e-6;  // stops when a step reduces the cost by less than this share
  CameraSystem system = CameraSystem::kAutomatic;

  [[nodiscard]] OptionFields fields() {
    return {{"max_iterations", max_iterations, at_least(0)}, {"tolerance", tolerance, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct BundleSolution {
  double cost_before = 0;  // the cost above
  double cost_after = 0;
  int iterations = 0;
  std::string error;  // why there is no solution, or ""; the problem is then unchanged
};

// Levenberg-Marquardt. Points are eliminated (the Schur complement: Triggs et al., 2000, section
// 6). The remaining symmetric system has a block for each two poses that see the same point, and is
// solved by Cholesky decomposition. It is dense for few poses or where most pairs of poses share
// points, else sparse.
//
// The loss enters the second derivatives. Perpendicular to a residual they are rho'. Along it they
// are rho' + 2 s rho'', but at least a share of rho' (Triggs et al., section 4.3). The share is
// initially 1, which is iteratively reweighted least squares. That is safe far from the minimum,
// but its steps are only half of the optimum where residuals are about as large as c. The share is
// halved while steps gain more than predicted, and grows after a failed step.
//
// The unknowns of a pose are a small rotation of the camera about its centre, and the centre. A
// long chain of cameras that bends moves far from the origin, and cameras move together with the
// points in front of them. With R and t as unknowns, a rotation by w at the distance L from the
// origin would cause an error of w^2 L / 2 between the two. For large problems whose steps gain
// less than predicted, the remaining second order is added to the steps (geodesic acceleration:
// Transtrum and Sethna, Improvements to the Levenberg-Marquardt algorithm, arXiv:1201.5885, 2012).
// With more than 80 poses, a small change ends the iteration only where damping is low enough for
// the whole to bend.
//
// Does not depend on the number of threads. Uses no random numbers. Throws Interrupted: the problem
// is then unchanged.
BundleSolution solve(BundleProblem& problem, const BundleSolverOptions& options,
                     const std::stop_token& stop = {});

// w (pi(R X + t) - u) of each observation, px; empty where a point is behind a camera.
[[nodiscard]] std::vector<Eigen::Vector2d> residuals_of(const BundleProblem& problem);

// Samples the centres of the poses under noise: each observation is the prediction of the problem's
// poses, points and lenses plus noise. Returns, for each sample, the centre of each pose. First
// order: one step of plain least squares, without `loss_px` and the actual observations. `sigma_px`
// >= 0: standard deviation of each coordinate of a weighted residual. Empty where the equations
// cannot be solved. Does not depend on the number of threads.
[[nodiscard]] std::vector<std::vector<Eigen::Vector3d>> centers_under_noise(BundleProblem problem,
                                                                            double sigma_px,
                                                                            int samples,
                                                                            std::uint64_t seed);

}  // namespace tarsier::sfm
