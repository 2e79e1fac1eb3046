// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/posit.h"

#include <Eigen/Core>

// The inside of posit(): iterations on a loaded workspace.
namespace tarsier::face::head {

struct PositSolver {
  const PositModel& model;
  const PositOptions& options;
  PositWorkspace& space;

  [[nodiscard]] PositResult classic();
  [[nodiscard]] PositResult homogeneous();
  [[nodiscard]] PlanarPositResult planar();

 private:
  struct State {
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation;  // of the centroid
    int iterations = 0;
    bool converged = false;
  };
  // The depths of space.wx become those of space.w; true where they hardly change any more.
  bool takes_depths(State& state);
  // Levenberg-Marquardt from `state`, at most `steps` of it.
  void refine(State& state, int steps) const;
  // Sum of weighted squared residuals; infinite where a point is behind the camera.
  [[nodiscard]] double cost(const Eigen::Matrix3d& rotation,
                            const Eigen::Vector3d& translation) const;
  [[nodiscard]] PositResult finish(State& state, int refine_steps) const;
  // One branch of the planar form: `sign` chooses the first solution.
  [[nodiscard]] PositResult planar_branch(double sign);
};

}  // namespace tarsier::face::head
