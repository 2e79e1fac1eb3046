// SPDX-License-Identifier: MIT
#include "tarsier/linalg/sparse_cholesky.h"

#include <gtest/gtest.h>

#include <vector>

namespace tarsier::linalg {
namespace {

// A chain of springs, each end held: the upper triangle.
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

TEST(SparseCholesky, SolvesAgainWithOtherNumbersInTheSamePlaces) {
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

TEST(SparseCholesky, FindsAMatrixThatIsNotPositiveDefinite) {
  SparseCholesky cholesky;
  cholesky.analyze(chain(20, 1));
  EXPECT_FALSE(cholesky.factorize(chain(20, 1)));
  EXPECT_TRUE(cholesky.factorize(chain(20, 2)));
}

// Variables of two numbers and one of three, each tied to the next; by elements, as the factor is thin.
TEST(SparseCholesky, TakesAMatrixByBlocks) {
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

// A factor that is rather full, which is made by tiles, then one of a chain by the same object.
TEST(SparseCholesky, TakesFullAndThinOnesInTurn) {
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
