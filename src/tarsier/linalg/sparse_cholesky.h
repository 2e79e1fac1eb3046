// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/tile_cholesky.h"

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <memory>
#include <optional>
#include <vector>

namespace tarsier::linalg {

// P A P^T = L L^T of a sparse symmetric positive definite matrix, n x n, with a fill-reducing
// elimination order P (Amestoy, Davis and Duff, An approximate minimum degree ordering algorithm,
// 1996; Eigen's). It works element by element, or by tile_cholesky.h if its dense matrix products
// are estimated to be faster. Compiled once, like decompositions.h.
class SparseCholesky {
 public:
  SparseCholesky();
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  // Computes the elimination order for matrices with the nonzero pattern of `a`, of which only the
  // upper triangle is read, or with the blocks of `pattern`. Call it before the other functions.
  void analyze(const Eigen::SparseMatrix<double>& a);
  void analyze(const BlockPattern& pattern);
  // Returns false if the matrix is not positive definite. The matrix is `a`, with the analysed
  // nonzero pattern, or given by the `values` of the blocks.
  [[nodiscard]] bool factorize(const Eigen::SparseMatrix<double>& a);
  [[nodiscard]] bool factorize(const std::vector<double>& values);
  // x with A x = b; requires a successful factorize().
  [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
  // Whether a factorization takes so many more operations than a solution that solve_near() is
  // faster. Requires analyze(pattern).
  [[nodiscard]] bool is_costly() const;
  // x with A x = b, where A has other `values` of the pattern's blocks, close to the factorized
  // matrix M. Conjugate gradients with the factor of M as preconditioner (Golub and Van Loan,
  // Matrix Computations, 11.5.2). They stop when r^T M^-1 r, with r = b - A x, is less than
  // `tolerance` squared times b^T M^-1 b. Returns nothing if this takes more than `max_iterations`
  // (each with one product and one solution), or if A proves not to be positive definite. Requires
  // analyze(pattern) and a successful factorize().
  [[nodiscard]] std::optional<Eigen::VectorXd> solve_near(const std::vector<double>& values,
                                                          const Eigen::VectorXd& b,
                                                          double tolerance,
                                                          int max_iterations) const;

 private:
  struct Factor;
  std::unique_ptr<Factor> factor_;
};

}  // namespace tarsier::linalg
