// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_cholesky.h"

#include "tarsier/core/rng.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>
#include <gtest/gtest.h>
#include <opencv2/core/types.hpp>
#include <opencv2/core/utility.hpp>

#include <cstdint>
#include <cstdlib>
#include <vector>

namespace tarsier::linalg {
namespace {

// A matrix of blocks.
struct Blocks {
  BlockPattern pattern;
  std::vector<double> values;
};

// Each element is a block.
Blocks blocks_of(const Eigen::SparseMatrix<double>& a) {
  Blocks result;
  for (int c = 0; c < a.cols(); ++c) {
    result.pattern.first.push_back(c);
    for (Eigen::SparseMatrix<double>::InnerIterator element(a, c); element; ++element) {
      result.pattern.blocks.push_back({static_cast<int>(element.row()), c});
      result.values.push_back(element.value());
    }
  }
  result.pattern.first.push_back(static_cast<int>(a.cols()));
  return result;
}

// The upper triangle of a positive definite matrix: a ring of variables in a mixed order, each
// connected to those within `reach`. One variable has no neighbours, and one is connected to all.
Eigen::SparseMatrix<double> ring(int size, int reach, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<int> number(static_cast<std::size_t>(size));
  for (int i = 0; i < size; ++i) number[static_cast<std::size_t>(i)] = (i * 7) % size;
  std::vector<Eigen::Triplet<double>> elements;
  for (int i = 0; i < size; ++i) {
    elements.emplace_back(i, i, 2.0 * reach);
    for (int k = 1; k <= reach; ++k) {
      const int one = number[static_cast<std::size_t>(i)];
      const int other = number[static_cast<std::size_t>((i + k) % size)];
      elements.emplace_back(std::min(one, other), std::max(one, other), rng.uniform(-0.9, 0.9));
    }
  }
  elements.emplace_back(size, size, 3.0);
  for (int i = 0; i < size; ++i) elements.emplace_back(i, size + 1, rng.uniform(-0.1, 0.1));
  elements.emplace_back(size + 1, size + 1, 0.1 * size);
  Eigen::SparseMatrix<double> a(size + 2, size + 2);
  a.setFromTriplets(elements.begin(), elements.end());
  return a;
}

Eigen::MatrixXd full(const Eigen::SparseMatrix<double>& upper) {
  return Eigen::MatrixXd(upper).selfadjointView<Eigen::Upper>();
}

TEST(TileCholesky, AgreesWithDenseCholesky) {
  for (const auto& [size, reach] : {std::pair(5, 1), std::pair(300, 4), std::pair(611, 60)}) {
    const Eigen::SparseMatrix<double> a = ring(size, reach, 3);
    const Blocks blocks = blocks_of(a);
    TileCholesky factor;
    factor.analyze(blocks.pattern);
    ASSERT_TRUE(factor.factorize(blocks.values.data())) << size;
    const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(a.cols(), -1, 2);
    const Eigen::VectorXd x = factor.solve(b);
    EXPECT_LT((full(a) * x - b).norm(), 1e-12 * b.norm()) << size;
    EXPECT_LT((full(a).llt().solve(b) - x).norm(), 1e-12 * x.norm()) << size;
  }
}

TEST(TileCholesky, SolvesOtherValuesOfTheSamePattern) {
  TileCholesky factor;
  factor.analyze(blocks_of(ring(400, 30, 3)).pattern);
  for (const std::uint64_t seed : {4U, 5U}) {
    const Eigen::SparseMatrix<double> a = ring(400, 30, seed);
    ASSERT_TRUE(factor.factorize(blocks_of(a).values.data()));
    const Eigen::VectorXd b = Eigen::VectorXd::Ones(a.cols());
    EXPECT_LT((full(a) * factor.solve(b) - b).norm(), 1e-11);
  }
}

TEST(TileCholesky, RefusesIndefiniteMatrices) {
  Eigen::SparseMatrix<double> a = ring(300, 20, 3);
  TileCholesky factor;
  factor.analyze(blocks_of(a).pattern);
  EXPECT_TRUE(factor.factorize(blocks_of(a).values.data()));
  for (const double wrong : {-1.0, 0.0}) {
    a.coeffRef(117, 117) = wrong;
    EXPECT_FALSE(factor.factorize(blocks_of(a).values.data()));
  }
}

// A ring costs as much as a band matrix, not as a full matrix.
TEST(TileCholesky, SkipsEmptyTiles) {
  TileCholesky factor;
  factor.analyze(blocks_of(ring(4800, 48, 3)).pattern);
  EXPECT_LT(factor.operations(), 0.05 * 4800.0 * 4800.0 * 4800.0 / 6);
}

// Poses of six numbers and lenses of seven, as in a bundle adjustment. A lens occupies two tiles.
Blocks poses_and_lens(int poses, int reach) {
  Rng rng(5);
  Blocks result;
  for (int v = 0; v <= poses; ++v) result.pattern.first.push_back(6 * v);
  result.pattern.first.push_back(6 * poses + 7);
  for (int column = 0; column <= poses; ++column) {
    for (int row = 0; row <= column; ++row) {
      if (column < poses && column - row > reach) continue;
      result.pattern.blocks.push_back({row, column});
      for (int c = 0; c < (column < poses ? 6 : 7); ++c)
        for (int r = 0; r < (row < poses ? 6 : 7); ++r)
          result.values.push_back(row == column && r == c ? 20 * reach : rng.uniform(-1, 1));
    }
  }
  return result;
}

Eigen::MatrixXd full(const Blocks& blocks) {
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(blocks.pattern.size(), blocks.pattern.size());
  const double* value = blocks.values.data();
  const std::vector<int>& first = blocks.pattern.first;
  for (const auto& [row, column] : blocks.pattern.blocks)
    for (int c = first[static_cast<std::size_t>(column)];
         c < first[static_cast<std::size_t>(column) + 1]; ++c)
      for (int r = first[static_cast<std::size_t>(row)];
           r < first[static_cast<std::size_t>(row) + 1]; ++r)
        a(r, c) = *value++;
  return a.selfadjointView<Eigen::Upper>();
}

// A square grid of variables of six numbers, each connected to those within `reach` rows and
// columns.
Blocks grid(int side, int reach) {
  Rng rng(5);
  Blocks result;
  for (int v = 0; v <= side * side; ++v) result.pattern.first.push_back(6 * v);
  for (int column = 0; column < side * side; ++column) {
    for (int row = 0; row <= column; ++row) {
      if (std::abs(row / side - column / side) > reach ||
          std::abs(row % side - column % side) > reach)
        continue;
      result.pattern.blocks.push_back({row, column});
      for (int k = 0; k < 36; ++k)
        result.values.push_back(row == column && k % 7 == 0 ? 300 : rng.uniform(-1, 1));
    }
  }
  return result;
}

// A narrow band order alone would give 2.1e9.
TEST(TileCholesky, AGridIsNotEliminatedInBandOrder) {
  TileCholesky factor;
  factor.analyze(grid(40, 2).pattern);
  EXPECT_LT(factor.operations(), 1.5e9);
  const Blocks blocks = grid(20, 2);
  factor.analyze(blocks.pattern);
  ASSERT_TRUE(factor.factorize(blocks.values.data()));
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(blocks.pattern.size(), -1, 2);
  EXPECT_LT((full(blocks) * factor.solve(b) - b).norm(), 1e-12 * b.norm());
}

// The streets between six by six square blocks, as a chain of cameras each: reverse Cuthill-McKee
// would give 4.9e8.
TEST(TileCholesky, StreetsAreEliminatedInMinimumDegreeOrder) {
  constexpr int kBlocks = 6;
  constexpr int kLength = 20;  // cameras along a side of a block
  constexpr int kReach = 5;
  std::vector<cv::Point> places;
  for (int y = 0; y <= kBlocks * kLength; ++y)
    for (int x = 0; x <= kBlocks * kLength; ++x)
      if (x % kLength == 0 || y % kLength == 0) places.emplace_back(x, y);
  const auto count = static_cast<int>(places.size());
  BlockPattern pattern;
  for (int v = 0; v <= count; ++v) pattern.first.push_back(6 * v);
  for (int column = 0; column < count; ++column) {
    for (int row = 0; row <= column; ++row) {
      const cv::Point d =
          places[static_cast<std::size_t>(row)] - places[static_cast<std::size_t>(column)];
      if (std::abs(d.x) + std::abs(d.y) <= kReach) pattern.blocks.push_back({row, column});
    }
  }
  TileCholesky factor;
  factor.analyze(pattern);
  EXPECT_LT(factor.operations(), 3e8);
}

TEST(TileCholesky, SolvesBlocksOfPosesAndALens) {
  const Blocks blocks = poses_and_lens(70, 9);
  TileCholesky factor;
  factor.analyze(blocks.pattern);
  ASSERT_TRUE(factor.factorize(blocks.values.data()));
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(blocks.pattern.size(), -1, 2);
  EXPECT_LT((full(blocks) * factor.solve(b) - b).norm(), 1e-12 * b.norm());
}

TEST(TileCholesky, ResultDoesNotDependOnThreads) {
  const Blocks blocks = poses_and_lens(150, 60);
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(blocks.pattern.size(), -1, 2);
  const auto solution = [&](int threads) {
    const int before = cv::getNumThreads();
    cv::setNumThreads(threads);
    TileCholesky factor;
    factor.analyze(blocks.pattern);
    EXPECT_TRUE(factor.factorize(blocks.values.data()));
    cv::setNumThreads(before);
    return factor.solve(b);
  };
  EXPECT_EQ(solution(1), solution(3));
}

}  // namespace
}  // namespace tarsier::linalg
