// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/tile_kernels.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::linalg {

// Where a symmetric matrix has numbers: blocks of variables, each of which has some numbers that follow each other. Their
// values are given block by block, and column by column in each.
struct BlockPattern {
  struct Block {
    int row = 0;  // variables, row <= column
    int column = 0;
  };
  std::vector<int> first;     // number at which each variable begins; and the end
  std::vector<Block> blocks;  // column by column, rows ascending; each variable has one with itself

  [[nodiscard]] int variables() const { return static_cast<int>(first.size()) - 1; }
  [[nodiscard]] int size() const { return first.back(); }  // of the matrix
  [[nodiscard]] int first_of(int variable) const {
    return first[static_cast<std::size_t>(variable)];
  }
  [[nodiscard]] int size_of(int variable) const {
    return first_of(variable + 1) - first_of(variable);
  }
};

// P A P^T = L L^T of a sparse symmetric positive definite matrix, n x n, whose factor L is rather full: the equations of
// cameras each of which has points in common with a hundred others. The variables are put in an order in which neighbours
// are near each other (Cuthill and McKee, Reducing the bandwidth of sparse symmetric matrices, 1969, reversed; or nested
// dissection, whichever fills less), those that nearly all others are tied to at the end, and cut into tiles of 48 numbers.
// Tiles are eliminated in the order of least fill (Amestoy, Davis and Duff 1996; Eigen's), and the work is products of dense
// matrices (Ng and Peyton, Block sparse Cholesky algorithms on advanced uniprocessor computers, 1993). The same numbers for
// any number of threads and any processor.
class TileCholesky {
 public:
  void analyze(BlockPattern pattern);
  // Multiplications that factorize() will take.
  [[nodiscard]] double operations() const;
  // .. and that solve() will.
  [[nodiscard]] double solve_operations() const;
  // False where the matrix is not positive definite. `values`: of the pattern's blocks; of those on the diagonal, the upper
  // triangle is read.
  [[nodiscard]] bool factorize(const double* values);
  // x with A x = b, after factorize() was true.
  [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;

 private:
  // Of L: the tiles of one column, that on the diagonal first. Numbers are of the order of elimination.
  struct Column {
    std::vector<int> below;  // rows of tiles, ascending
    std::vector<int> from;   // earlier columns that reach this one, ascending
    int first = 0;           // its place in tiles_
  };
  // A tile that is not full, and its numbers; beyond them, its diagonal is 1.
  struct Padded {
    int tile = 0;
    int size = kTileSize;
  };
  // Tiles and their fill, where the variables are cut into tiles in this order.
  void analyze_in_order(const std::vector<int>& variables);
  void order_tiles(const std::vector<int>& variables);
  void find_fill(std::vector<std::vector<int>> below);
  void fill(const double* values);
  // Where a tile of a column lies in tiles_; -1: it is empty.
  [[nodiscard]] int tile_at(int row, int column) const;
  [[nodiscard]] double* numbers(int tile) { return tiles_.ptr<double>(tile); }
  [[nodiscard]] const double* numbers(int tile) const { return tiles_.ptr<double>(tile); }
  void subtract_earlier(int row, int column);
  [[nodiscard]] static bool factorize_diagonal(double* tile);

  BlockPattern pattern_;
  std::vector<int> place_;  // of each number, in the order of elimination
  std::vector<Column> columns_;
  Padded padded_;
  int tile_count_ = 0;
  cv::Mat tiles_;  // a row each, as tile_kernels.h says
};

}  // namespace tarsier::linalg
