// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/bundle.h"

#include "tarsier/core/at.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/bundle/bundle_problem.h"
#include "tarsier/sfm/bundle/bundle_solver.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

namespace tarsier::sfm {
namespace {

void apply_parameters(const LensParameters& parameters, geometry::Camera& camera) {
  camera.fx = parameters[0];
  camera.fy = parameters[0] * parameters[1];
  camera.cx = parameters[2];
  camera.cy = parameters[3];
  for (std::size_t k = 0; k < 5; ++k) camera.distortion[k] = parameters[4 + k];
}

// Whether a lens is a valid result of an adjustment.
bool is_valid_lens(const geometry::Camera& after, const geometry::Camera& before) {
  const auto is_finite = [](double number) { return std::isfinite(number); };
  if (!std::all_of(after.distortion.begin(), after.distortion.end(), is_finite) ||
      !std::isfinite(after.cx) || !std::isfinite(after.cy)) {
    return false;
  }
  const double larger = std::max(after.width, after.height);
  const auto allowed = [&](double focal, double start) {
    return focal >= std::min(start, kMinFocalShare * larger) &&
           focal <= std::max(start, kMaxFocalShare * larger);
  };
  return allowed(after.fx, before.fx) && allowed(after.fy, before.fy);
}

// Removes rounding errors accumulated over many rotations.
geometry::Rigid3 orthonormalized(const geometry::Rigid3& pose) {
  return {geometry::rotation_of(geometry::quaternion_of(pose.rotation)), pose.translation};
}

}  // namespace

BundleReport adjust(Model& model, const BundleOptions& options, const std::stop_token& stop) {
  options.check();
  BundleReport report;
  ModelProblem of_model = problem_of(model, options);
  BundleProblem& problem = of_model.problem;
  const std::vector<int>& images = of_model.images;
  const std::vector<int>& cameras = of_model.cameras;
  std::vector<int>& points = of_model.points;
  if (points.empty()) return report;
  report.residuals = static_cast<int>(problem.measurements.size());

  BundleSolverOptions solver_options;
  solver_options.max_iterations = options.max_iterations;
  solver_options.tolerance = options.tolerance;
  const BundleSolution solution = solve(problem, solver_options, stop);
  report.iterations = solution.iterations;
  report.warning = solution.error;
  if (!solution.error.empty()) return report;
  if (!problem.free_parameters.empty()) {
    for (std::size_t lens = 0; lens < cameras.size(); ++lens) {
      const geometry::Camera& before = model.cameras[at(cameras[lens])];
      geometry::Camera after = before;
      apply_parameters(problem.lenses[lens], after);
      if (is_valid_lens(after, before)) continue;
      BundleOptions again = options;
      again.focal = again.center = again.distortion = false;
      again.points = std::move(points);
      report = adjust(model, again, stop);
      report.warning = fmt::format(
                           "the adjusted camera is implausible (focal length {:.4g} px): the "
                           "camera with {:.4g} px stays unchanged",
                           after.fx, before.fx) +
                       (report.warning.empty() ? "" : "; " + report.warning);
      return report;
    }
    for (std::size_t lens = 0; lens < cameras.size(); ++lens)
      apply_parameters(problem.lenses[lens], model.cameras[at(cameras[lens])]);
  }
  for (std::size_t i = 0; i < images.size(); ++i)
    if (problem.pose_moves[i] != 0)
      model.images[at(images[i])].pose = orthonormalized(problem.poses[i]);
  for (std::size_t k = 0; k < points.size(); ++k)
    model.points[at(points[k])].position = problem.points[k];
  return report;
}

void adjust_pose(geometry::Rigid3& pose, const geometry::Camera& camera,
                 const std::vector<Correspondence2D3D>& seen, double loss_px) {
  if (seen.size() < 3) return;
  BundleProblem problem;
  problem.loss_px = loss_px;
  problem.poses = {pose};
  problem.pose_moves = {1};
  problem.lenses = {lens_parameters_of(camera)};
  for (const Correspondence2D3D& correspondence : seen) {
    problem.first.push_back(problem.measurements.size());
    problem.points.push_back(correspondence.position);
    problem.point_moves.push_back(0);
    problem.measurements.push_back({0, 0, correspondence.pixel.x, correspondence.pixel.y, 1});
  }
  problem.first.push_back(problem.measurements.size());
  BundleSolverOptions solver_options;
  solver_options.max_iterations = 30;
  if (solve(problem, solver_options).error.empty()) pose = orthonormalized(problem.poses[0]);
}

}  // namespace tarsier::sfm
