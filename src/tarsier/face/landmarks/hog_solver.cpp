// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/hog_solver.h"

namespace tarsier::face::landmarks::inner {

dlib::matrix<double, 0, 1> minimize_risk(
    const dlib::oca_problem<dlib::matrix<double, 0, 1>>& problem) {
  dlib::matrix<double, 0, 1> weights;
  const dlib::oca solver;
  solver(problem, weights);
  return weights;
}

}  // namespace tarsier::face::landmarks::inner
