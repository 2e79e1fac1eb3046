// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/posit.h"

#include <Eigen/Core>

// Implementation of posit(): iterations on a loaded workspace.
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
  // Replaces the depths space.w by space.wx; true if they hardly changed.
  bool update_depths(State& state);
  // Levenberg-Marquardt from `state`, at most `steps` steps.
  void refine(State& state, int steps) const;
  // Sum of weighted squared residuals; infinite if a point is behind the camera.
  [[nodiscard]] double cost(const Eigen::Matrix3d& rotation,
                            const Eigen::Vector3d& translation) const;
  [[nodiscard]] PositResult finish(State& state, int refine_steps) const;
  // One branch of the planar form; `sign` selects the first solution.
  [[nodiscard]] PositResult planar_branch(double sign);
};

}  // namespace tarsier::face::head
