// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/tile_cholesky.h"

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <memory>
#include <optional>
#include <vector>

namespace tarsier::linalg {

// P A P^T = L L^T of a sparse symmetric positive definite matrix, n x n, with an order of elimination P of least fill (Amestoy,
// Davis and Duff, An approximate minimum degree ordering algorithm, 1996; Eigen's), element by element; or by
// tile_cholesky.h, where its products of dense matrices are reckoned to be faster. Compiled once, as decompositions.h.
class SparseCholesky {
 public:
  SparseCholesky();
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  // The order of elimination for matrices with the nonzero elements of `a`, of which only the upper triangle is read; or with
  // the blocks of `pattern`. Comes before the others.
  void analyze(const Eigen::SparseMatrix<double>& a);
  void analyze(const BlockPattern& pattern);
  // False where the matrix is not positive definite: `a`, with the nonzero elements that were analyzed, or that of the
  // `values` of the blocks.
  [[nodiscard]] bool factorize(const Eigen::SparseMatrix<double>& a);
  [[nodiscard]] bool factorize(const std::vector<double>& values);
  // x with A x = b, after factorize() was true.
  [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
  // Whether a factorization takes so many more operations than a solution that solve_near() is the faster one. After
  // analyze(pattern).
  [[nodiscard]] bool is_costly() const;
  // x with A x = b, where A is the matrix of other `values` of the pattern's blocks, near to the one that was factorized:
  // conjugate gradients with that one's factor as preconditioner (Golub and Van Loan, Matrix Computations, 11.5.2). They end
  // where r^T M^-1 r, with r = b - A x and M the matrix that was factorized, is less than `tolerance` squared times
  // b^T M^-1 b. Nothing where that takes more than `max_iterations`, of a product and a solution each, or where A is seen
  // not to be positive definite. After analyze(pattern), and after factorize() was true.
  [[nodiscard]] std::optional<Eigen::VectorXd> solve_near(const std::vector<double>& values,
                                                          const Eigen::VectorXd& b,
                                                          double tolerance,
                                                          int max_iterations) const;

 private:
  struct Factor;
  std::unique_ptr<Factor> factor_;
};

}  // namespace tarsier::linalg
