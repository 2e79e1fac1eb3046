// SPDX-License-Identifier: MIT
#pragma once

#include <dlib/matrix.h>
#include <dlib/optimization/optimization_oca.h>

// dlib's optimiser, which is compiled in one file of its own.
namespace tarsier::face::landmarks::inner {

// The weights that minimise the problem's regularised risk. Passes on exceptions of the problem.
[[nodiscard]] dlib::matrix<double, 0, 1> minimize_risk(
    const dlib::oca_problem<dlib::matrix<double, 0, 1>>& problem);

}  // namespace tarsier::face::landmarks::inner
