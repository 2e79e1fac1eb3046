// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_cholesky.h"

#include "tarsier/core/rng.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

namespace tarsier::linalg {
namespace {

// The upper triangle of a positive definite matrix: a ring of variables, each tied to those within `reach` of it, in a mixed
// order, one that has no neighbours, and one that is tied to all.
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

TEST(TileCholesky, SolvesAsADenseOneDoes) {
  for (const auto& [size, reach] : {std::pair(5, 1), std::pair(300, 4), std::pair(611, 60)}) {
    const Eigen::SparseMatrix<double> a = ring(size, reach, 3);
    TileCholesky factor;
    factor.analyze(a);
    ASSERT_TRUE(factor.factorize(a)) << size;
    const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(a.cols(), -1, 2);
    const Eigen::VectorXd x = factor.solve(b);
    EXPECT_LT((full(a) * x - b).norm(), 1e-12 * b.norm()) << size;
    EXPECT_LT((full(a).llt().solve(b) - x).norm(), 1e-12 * x.norm()) << size;
  }
}

TEST(TileCholesky, OtherNumbersAtTheSamePlaces) {
  TileCholesky factor;
  factor.analyze(ring(400, 30, 3));
  for (const std::uint64_t seed : {4U, 5U}) {
    const Eigen::SparseMatrix<double> a = ring(400, 30, seed);
    ASSERT_TRUE(factor.factorize(a));
    const Eigen::VectorXd b = Eigen::VectorXd::Ones(a.cols());
    EXPECT_LT((full(a) * factor.solve(b) - b).norm(), 1e-11);
  }
}

TEST(TileCholesky, WhatIsNotPositiveDefiniteIsRefused) {
  Eigen::SparseMatrix<double> a = ring(300, 20, 3);
  TileCholesky factor;
  factor.analyze(a);
  EXPECT_TRUE(factor.factorize(a));
  a.coeffRef(117, 117) = -1;
  EXPECT_FALSE(factor.factorize(a));
}

// A ring takes the work of a band, not that of a full matrix.
TEST(TileCholesky, LeavesOutWhatIsEmpty) {
  TileCholesky factor;
  factor.analyze(ring(4800, 48, 3));
  EXPECT_LT(factor.operations(), 0.05 * 4800.0 * 4800.0 * 4800.0 / 6);
}

}  // namespace
}  // namespace tarsier::linalg
