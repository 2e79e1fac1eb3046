// SPDX-License-Identifier: MIT
#include "tarsier/linalg/sparse_cholesky.h"

#include <gtest/gtest.h>

#include <vector>

namespace tarsier::linalg {
namespace {

// The upper triangle of a chain of springs with both ends fixed.
Eigen::SparseMatrix<double> chain(int n, double diagonal) {
  std::vector<Eigen::Triplet<double>> numbers;
  for (int i = 0; i < n; ++i) {
    numbers.emplace_back(i, i, diagonal);
    if (i > 0) numbers.emplace_back(i - 1, i, -1);
  }
  Eigen::SparseMatrix<double> result(n, n);
  result.setFromTriplets(numbers.begin(), numbers.end());
  return result;
}

TEST(SparseCholesky, SolvesOtherValuesOfTheSamePattern) {
  constexpr int kSize = 200;
  SparseCholesky cholesky;
  cholesky.analyze(chain(kSize, 2));
  for (const double diagonal : {2.0, 3.0}) {
    const Eigen::SparseMatrix<double> a = chain(kSize, diagonal);
    ASSERT_TRUE(cholesky.factorize(a));
    const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(kSize, -1, 5);
    const Eigen::VectorXd b = a.selfadjointView<Eigen::Upper>() * x;
    EXPECT_LT((cholesky.solve(b) - x).norm(), 1e-8);
  }
}

TEST(SparseCholesky, DetectsIndefiniteMatrices) {
  SparseCholesky cholesky;
  cholesky.analyze(chain(20, 1));
  EXPECT_FALSE(cholesky.factorize(chain(20, 1)));
  EXPECT_TRUE(cholesky.factorize(chain(20, 2)));
}

// Two variables of two numbers and one of three, each connected to the next. The factor is thin, so
// it is computed element by element.
TEST(SparseCholesky, AcceptsABlockPattern) {
  const BlockPattern pattern{{0, 2, 4, 7}, {{0, 0}, {0, 1}, {1, 1}, {1, 2}, {2, 2}}};
  const std::vector<double> values{4,  9,  1,  5, .1, .2, .3, .4, 6, 9, 1, 7, .5, .6,
                                   .7, .8, .9, 1, 8,  9,  9,  1,  8, 9, 2, 1, 8};
  Eigen::MatrixXd a(7, 7);
  a << 4, 1, .1, .3, 0, 0, 0,    //
      1, 5, .2, .4, 0, 0, 0,     //
      .1, .2, 6, 1, .5, .7, .9,  //
      .3, .4, 1, 7, .6, .8, 1,   //
      0, 0, .5, .6, 8, 1, 2,     //
      0, 0, .7, .8, 1, 8, 1,     //
      0, 0, .9, 1, 2, 1, 8;
  const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(7, -1, 5);
  SparseCholesky cholesky;
  cholesky.analyze(pattern);
  for (int times = 0; times < 2; ++times) {
    ASSERT_TRUE(cholesky.factorize(values));
    EXPECT_LT((cholesky.solve(a * x) - x).norm(), 1e-12);
  }
}

// A matrix of blocks of two numbers, each connected to all others: `tie` between two, `own` on the
// diagonal.
struct FullBlocks {
  BlockPattern pattern;
  std::vector<double> values;
  Eigen::MatrixXd matrix;

  FullBlocks(int variables, double own, double tie)
      : matrix(Eigen::MatrixXd::Zero(2 * variables, 2 * variables)) {
    for (int column = 0; column < variables; ++column) {
      pattern.first.push_back(2 * column);
      for (int row = 0; row <= column; ++row) {
        pattern.blocks.push_back({row, column});
        Eigen::Matrix2d block;
        block << tie, 0.5 * tie, -0.5 * tie, tie / (1 + column - row);
        if (row == column) block = Eigen::Vector2d(own, own + column).asDiagonal();
        values.insert(values.end(), block.data(), block.data() + 4);
        matrix.block<2, 2>(2 * row, 2 * column) = block;
        matrix.block<2, 2>(2 * column, 2 * row) = block.transpose();
      }
    }
    pattern.first.push_back(2 * variables);
  }
};

TEST(SparseCholesky, SolvesAMatrixNearTheOneItFactorized) {
  const FullBlocks first(40, 90, 1);
  const FullBlocks near(40, 110, 1.1);
  SparseCholesky cholesky;
  cholesky.analyze(first.pattern);
  ASSERT_TRUE(cholesky.factorize(first.values));
  const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(80, -1, 5);
  const Eigen::VectorXd b = near.matrix * x;
  const auto solution = cholesky.solve_near(near.values, b, 1e-10, 20);
  ASSERT_TRUE(solution);
  EXPECT_LT((*solution - x).norm(), 1e-8);
  EXPECT_GT((cholesky.solve(b) - x).norm(), 1e-2) << "not that of the other matrix";
  // The same matrix takes one iteration, the changed one more than two.
  EXPECT_TRUE(cholesky.solve_near(first.values, first.matrix * x, 1e-10, 1));
  EXPECT_FALSE(cholesky.solve_near(near.values, b, 1e-10, 2));
  const FullBlocks negative(40, -90, 1);
  EXPECT_FALSE(cholesky.solve_near(negative.values, b, 1e-10, 20));
}

TEST(SparseCholesky, FullMatricesAreCostlyAndSmallOnesAreNot) {
  SparseCholesky cholesky;
  cholesky.analyze(FullBlocks(40, 90, 1).pattern);
  EXPECT_FALSE(cholesky.is_costly());
  cholesky.analyze(FullBlocks(700, 2000, 1).pattern);
  EXPECT_TRUE(cholesky.is_costly());
}

// A nearly full factor, computed by tiles, and then the factor of a chain, by the same object.
TEST(SparseCholesky, AlternatesDenseAndSparseMatrices) {
  constexpr int kSize = 900;
  std::vector<Eigen::Triplet<double>> numbers;
  for (int c = 0; c < kSize; ++c)
    for (int r = 0; r <= c; ++r) numbers.emplace_back(r, c, r == c ? kSize : 1.0 / (1 + c - r));
  Eigen::SparseMatrix<double> full(kSize, kSize);
  full.setFromTriplets(numbers.begin(), numbers.end());
  SparseCholesky cholesky;
  for (const Eigen::SparseMatrix<double>& a : {full, chain(kSize, 3), full}) {
    cholesky.analyze(a);
    ASSERT_TRUE(cholesky.factorize(a));
    const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(kSize, -1, 5);
    const Eigen::VectorXd b = a.selfadjointView<Eigen::Upper>() * x;
    EXPECT_LT((cholesky.solve(b) - x).norm(), 1e-8);
  }
}

}  // namespace
}  // namespace tarsier::linalg
