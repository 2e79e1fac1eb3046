// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/tile_kernels.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <vector>

namespace tarsier::linalg {

// The nonzero blocks of a symmetric matrix. A variable covers several consecutive rows. The values
// are given block by block, column-major in each block.
struct BlockPattern {
  struct Block {
    int row = 0;  // variables, row <= column
    int column = 0;
  };
  std::vector<int> first;  // first row of each variable; and the total number of rows
  // Column by column, rows ascending; each variable has a diagonal block.
  std::vector<Block> blocks;

  [[nodiscard]] int variables() const { return static_cast<int>(first.size()) - 1; }
  [[nodiscard]] int size() const { return first.back(); }  // of the matrix
  [[nodiscard]] int first_of(int variable) const {
    return first[static_cast<std::size_t>(variable)];
  }
  [[nodiscard]] int size_of(int variable) const {
    return first_of(variable + 1) - first_of(variable);
  }
};

// P A P^T = L L^T of a sparse symmetric positive definite matrix, n x n, with a rather dense factor
// L: for example the equations of cameras that each share points with a hundred others.
// The variables are ordered by reverse Cuthill-McKee (Reducing the bandwidth of sparse symmetric
// matrices, 1969), where those tied to nearly all others come last, or by minimum degree
// (Amestoy, Davis and Duff 1996; Eigen's), whichever fills less. The order is cut into tiles of
// 24 rows. Tiles are eliminated in a minimum-degree order, by products of dense matrices (Ng and
// Peyton, Block sparse Cholesky algorithms on advanced uniprocessor computers, 1993). The result
// is the same for any number of threads and any processor.
class TileCholesky {
 public:
  void analyze(BlockPattern pattern);
  // Number of multiplications of factorize().
  [[nodiscard]] double operations() const;
  // Number of multiplications of solve().
  [[nodiscard]] double solve_operations() const;
  // Returns false if the matrix is not positive definite. `values`: of the pattern's blocks; of
  // diagonal blocks only the upper triangle is read.
  [[nodiscard]] bool factorize(const double* values);
  // x with A x = b; requires a successful factorize().
  [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;

 private:
  // The tiles of one column of L, the diagonal tile first. Indices are in the elimination order.
  struct Column {
    std::vector<int> below;  // rows of tiles, ascending
    std::vector<int> from;   // earlier columns that update this one, ascending
    int first = 0;           // index in tiles_
  };
  // A product left * right^T of tiles of an earlier column that is subtracted from a tile.
  struct Product {
    int left = 0;  // index in tiles_
    int right = 0;
  };
  // The tile that is not full, and its number of rows; the rest of its diagonal is 1.
  struct Padded {
    int tile = 0;
    int size = kTileSize;
  };
  // Computes the tiles and their fill for this order of the variables.
  void analyze_in_order(const std::vector<int>& variables);
  void order_tiles(const std::vector<int>& variables);
  void factorize_symbolically(std::vector<std::vector<int>> below);
  void list_products();
  void locate_blocks();
  void fill(const double* values);
  // An element of the lower triangle, at these positions in the elimination order.
  [[nodiscard]] double& element(int one, int other);
  // Index in tiles_ of a tile of a column; -1 if it is empty.
  [[nodiscard]] int tile_at(int row, int column) const;
  [[nodiscard]] double* numbers(int tile) { return tiles_.ptr<double>(tile); }
  [[nodiscard]] const double* numbers(int tile) const { return tiles_.ptr<double>(tile); }
  void subtract_products(int tile);
  [[nodiscard]] static bool factorize_diagonal(double* tile);

  BlockPattern pattern_;
  std::vector<int> position_;  // position of each row in the elimination order
  std::vector<Column> columns_;
  std::vector<Product> products_;           // tile by tile
  std::vector<std::size_t> first_product_;  // of each tile; and their total number
  std::vector<int> tile_of_block_;          // index in tiles_
  Padded padded_;
  int tile_count_ = 0;
  cv::Mat tiles_;  // one row per tile, in the layout of tile_kernels.h
};

}  // namespace tarsier::linalg
