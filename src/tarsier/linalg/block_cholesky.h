// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

namespace tarsier::linalg {

// Replaces B (n x k) by X with A X = B, for a symmetric positive definite A (n x n) in single precision, and the lower triangle
// of A by L with A = L L^T; only that triangle is read. By blocks of columns, each corrected by all that lie left of it
// (Golub and Van Loan, Matrix Computations, 4.2.6), with the kernels of gemm.h. One thread. False where A is not positive
// definite; A and B are of no use then.
[[nodiscard]] bool solve_positive_definite(Eigen::MatrixXf& a, Eigen::MatrixXf& b);

}  // namespace tarsier::linalg
