// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <vector>

namespace tarsier::linalg {

// P A P^T = L L^T of a sparse symmetric positive definite matrix, n x n, whose factor L is rather full: the equations of
// cameras each of which has points in common with a hundred others. The variables are put in an order in which neighbours
// are near each other (Cuthill and McKee, Reducing the bandwidth of sparse symmetric matrices, 1969, reversed), those that
// nearly all others are tied to at the end, and cut into tiles of 48. Tiles are eliminated in the order of least fill
// (Amestoy, Davis and Duff 1996; Eigen's), and the work is products of dense matrices (Ng and Peyton, Block sparse Cholesky
// algorithms on advanced uniprocessor computers, 1993). One thread; the same numbers for the same matrix.
class TileCholesky {
 public:
  // For matrices with the nonzero elements of `a`, of which only the upper triangle is read.
  void analyze(const Eigen::SparseMatrix<double>& a);
  // Multiplications that factorize() will take.
  [[nodiscard]] double operations() const;
  // False where `a`, with the nonzero elements that were analyzed, is not positive definite.
  [[nodiscard]] bool factorize(const Eigen::SparseMatrix<double>& a);
  // x with A x = b, after factorize() was true.
  [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;

 private:
  // Of L: the columns of one tile, and the tiles below the diagonal that they have. Numbers are of the order of elimination.
  struct Column {
    Eigen::Index begin = 0;  // its first variable
    Eigen::Index size = 0;
    std::vector<int> below;            // tiles, ascending
    std::vector<Eigen::Index> offset;  // of each of them: its first row in `panel`; and the end
    std::vector<int> from;             // earlier columns that reach this one, ascending
    Eigen::MatrixXd panel;             // the tile on the diagonal, then those below
  };
  void order_tiles(const Eigen::SparseMatrix<double>& a);
  void find_fill(std::vector<std::vector<int>> below);
  // Where the rows of a tile begin in the panel of a column.
  [[nodiscard]] static Eigen::Index row_of(const Column& column, int self, int tile);
  void update(int target, int source, Eigen::MatrixXd& product);

  std::vector<int> place_;  // of each variable, in the order of elimination
  std::vector<int> tile_;   // of each place
  std::vector<Column> columns_;
};

}  // namespace tarsier::linalg
