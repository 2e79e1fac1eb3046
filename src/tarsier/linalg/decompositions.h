// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

// Decompositions of dense matrices in double precision (Golub and Van Loan, Matrix Computations).
// Eigen does the computation. It is compiled once here, because its templates cost seconds in each
// file that instantiates them.
namespace tarsier::linalg {

using ConstMatrix = Eigen::Ref<const Eigen::MatrixXd>;  // also binds to a block without a copy

// A = L L^T of a symmetric positive definite n x n matrix. Only the lower triangle is read.
class Cholesky {
 public:
  Cholesky() = default;  // ok() is false
  explicit Cholesky(const ConstMatrix& a) { compute(a); }
  // Returns false if `a` is not positive definite; then ok() is also false.
  bool compute(const ConstMatrix& a);
  [[nodiscard]] bool ok() const { return ok_; }
  // X with A X = B, n x k. Not finite if !ok().
  [[nodiscard]] Eigen::MatrixXd solve(const ConstMatrix& b) const;
  // L, n x n; zeros above the diagonal.
  [[nodiscard]] Eigen::MatrixXd lower() const;

 private:
  Eigen::MatrixXd factor_;  // L in the lower triangle
  bool ok_ = false;
};

// X with A X = B for a symmetric A, n x n, by A = P^T L D L^T P. Only the lower triangle is read.
// If A is singular and B is not in its range, the result is meaningless or not finite.
[[nodiscard]] Eigen::MatrixXd solve_symmetric(const ConstMatrix& a, const ConstMatrix& b);

// X with A X = B for any invertible A, n x n, by Gaussian elimination with row pivoting.
[[nodiscard]] Eigen::MatrixXd solve_general(const ConstMatrix& a, const ConstMatrix& b);

// A = V diag(values) V^T.
struct SymmetricEigen {
  Eigen::VectorXd values;   // n, ascending
  Eigen::MatrixXd vectors;  // n x n, orthonormal columns with arbitrary signs
};

// For a symmetric matrix, n x n; only the lower triangle is read. Throws std::invalid_argument if
// the QR iteration does not converge (a matrix that is not finite).
[[nodiscard]] SymmetricEigen symmetric_eigen(const ConstMatrix& a);
// Generalised problem A v = value B v for a symmetric A and a positive definite B; V^T B V = I.
[[nodiscard]] SymmetricEigen symmetric_eigen(const ConstMatrix& a, const ConstMatrix& b);

// A = U diag(values) V^T with r = min(rows, columns), by Jacobi rotations.
struct LeftSvd {
  Eigen::MatrixXd u;       // rows x r, orthonormal columns
  Eigen::VectorXd values;  // r, descending, >= 0
};
[[nodiscard]] LeftSvd left_svd(const ConstMatrix& a);

// An orthonormal basis of the column space of A, rows x columns (rows >= columns, full rank), by
// Householder reflections.
[[nodiscard]] Eigen::MatrixXd orthonormal_basis(const ConstMatrix& a);

}  // namespace tarsier::linalg
