// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

namespace tarsier::linalg {

// Replaces B (n x k) by X with A X = B, for a symmetric positive definite A (n x n) in single
// precision. Only the lower triangle of A is read; it is replaced by L with A = L L^T. The
// algorithm is left-looking over blocks of columns (Golub and Van Loan, Matrix Computations,
// 4.2.6), with the kernels of gemm.h. One thread. Returns false if A is not positive definite; A
// and B are then invalid.
[[nodiscard]] bool solve_positive_definite(Eigen::MatrixXf& a, Eigen::MatrixXf& b);

}  // namespace tarsier::linalg
