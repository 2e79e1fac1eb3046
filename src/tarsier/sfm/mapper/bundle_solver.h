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

// The numbers of a lens: f, the ratio fy / fx, cx, cy, k1, k2, p1, p2, k3.
using LensNumbers = std::array<double, 9>;

// A bundle adjustment as numbers: poses, points and lenses that minimise
//
//   1/2 sum over observations of rho(s),  s = |w (pi(R X + t) - u)|^2,  rho(s) = c^2 log(1 + s /
//   c^2)
//
// with pi the pinhole camera with OpenCV's distortion, w the observation's weight, and c = loss_px
// (Cauchy's loss; 0: plain squares).
struct BundleProblem {
  struct Seen {
    int pose = 0;
    int lens = 0;
    double u = 0;  // px
    double v = 0;
    double weight = 1;
  };
  // Pulls one coordinate of the centre of a moving camera to a value, as a residual.
  struct Hold {
    int pose = 0;
    int axis = 0;
    double value = 0;
    double weight = 1;
  };
  std::vector<geometry::Rigid3> poses;  // camera_from_world
  std::vector<char> pose_moves;         // of each pose
  std::vector<LensNumbers> lenses;
  std::vector<int> free_numbers;        // of every lens that moves, ascending; empty: lenses stay
  std::vector<char> lens_moves;         // of each lens; empty: all do
  std::vector<Eigen::Vector3d> points;  // world
  std::vector<char> point_moves;        // of each point
  // The observations point by point: those of point p are seen[first[p]] to seen[first[p + 1] - 1].
  std::vector<std::size_t> first;
  std::vector<Seen> seen;
  std::optional<Hold> hold;
  double loss_px = 0;
};

// How the equations of poses and lenses are solved.
enum class CameraSystem { kAutomatic, kDense, kSparse };

struct BundleSolverOptions {
  int max_iterations = 50;
  double tolerance = 1e-6;  // ends when a step takes less than this share off the sum
  CameraSystem system = CameraSystem::kAutomatic;

  [[nodiscard]] OptionFields fields() {
    return {{"max_iterations", max_iterations, at_least(0)}, {"tolerance", tolerance, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct BundleSolution {
  double cost_before = 0;  // the sum above
  double cost_after = 0;
  int iterations = 0;
  std::string trouble;  // why there is no solution, or ""; the problem is then as it was
};

// Levenberg and Marquardt's method. Points are eliminated (the Schur complement: Triggs et al.,
// 2000, section 6), and what is left, a symmetric system with a block for each two poses that see
// the same point, is solved by Cholesky's decomposition. A dense one for few poses or where most
// pairs of poses share points, else a sparse one.
//
// The loss enters the second derivatives: across a residual they are rho', along it
// rho' + 2 s rho'', but at least a share of rho' (Triggs et al., section 4.3). That share is 1 at
// first, which is reweighted least squares: safe far from the minimum, but its steps are half as
// long as they should be where residuals are about as large as c. It is halved while steps gain
// more than they promise, and grows where one fails.
//
// The unknowns of a pose are a small rotation of the camera about its own centre, and its centre. A long chain of
// cameras that bends moves far from the origin; cameras and the points in front of them then move alike. With R and t
// as unknowns, a rotation by w at the distance L from the origin would leave w^2 L / 2 between the two. What is left of
// the second order is added to the steps of large problems whose steps gain less than they promise (geodesic
// acceleration: Transtrum and Sethna, Improvements to the Levenberg-Marquardt algorithm, arXiv:1201.5885, 2012). Of
// more than 80 poses, a small change ends the search only where damping is low enough for the whole to bend.
//
// The result does not depend on the number of threads. No random numbers. Throws Interrupted when stopped: the problem is then as it was.
BundleSolution solve(BundleProblem& problem, const BundleSolverOptions& options,
                     const std::stop_token& stop = {});

// w (pi(R X + t) - u) of each observation, px; none where a point lies behind a camera.
[[nodiscard]] std::vector<Eigen::Vector2d> residuals_of(const BundleProblem& problem);

// Where the centres of the poses go if each observation is what the problem's poses, points and lenses predict, and noise:
// sample by sample, of each pose; to first order, by one step of plain least squares (`loss_px` and what was observed do not
// count). `sigma_px` >= 0: standard deviation of each coordinate of a weighted residual. No samples where the equations
// cannot be solved. The same for any number of threads.
[[nodiscard]] std::vector<std::vector<Eigen::Vector3d>> centers_under_noise(BundleProblem problem,
                                                                            double sigma_px,
                                                                            int samples,
                                                                            std::uint64_t seed);

}  // namespace tarsier::sfm
