// SPDX-License-Identifier: MIT
#include "tarsier/linalg/block_cholesky.h"

#include <gtest/gtest.h>

namespace tarsier::linalg {
namespace {

// Entries in [-1, 1] from a generator of full period, the same on every machine.
Eigen::MatrixXf random_matrix(Eigen::Index rows, Eigen::Index columns, unsigned seed) {
  Eigen::MatrixXf values(rows, columns);
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    seed = seed * 1664525U + 1013904223U;
    values.data()[i] = static_cast<float>(seed >> 8U) / 8388608.F - 1;
  }
  return values;
}

TEST(BlockCholesky, SolvesSystemsOfAnySize) {
  for (const auto& [n, k] : {std::pair{1, 1}, {47, 3}, {48, 48}, {49, 50}, {300, 100}}) {
    const Eigen::MatrixXf half = random_matrix(2 * n, n, 7);
    const Eigen::MatrixXf a =
        half.transpose() * half + Eigen::MatrixXf::Identity(n, n) * static_cast<float>(n);
    const Eigen::MatrixXf expected = random_matrix(n, k, 8);
    Eigen::MatrixXf x = a * expected;
    Eigen::MatrixXf lower = a;
    lower.triangularView<Eigen::StrictlyUpper>().setConstant(1e9F);  // is not read
    ASSERT_TRUE(solve_positive_definite(lower, x)) << n;
    EXPECT_LT((x - expected).cwiseAbs().maxCoeff(), 2e-5F) << n << " " << k;
    const Eigen::MatrixXf l = lower.triangularView<Eigen::Lower>();
    EXPECT_LT((l * l.transpose() - a).cwiseAbs().maxCoeff(), 1e-5F * a.cwiseAbs().maxCoeff()) << n;
  }
}

TEST(BlockCholesky, RefusesIndefiniteMatrices) {
  Eigen::MatrixXf a = Eigen::MatrixXf::Identity(100, 100);
  a(97, 97) = -1;
  Eigen::MatrixXf b = Eigen::MatrixXf::Ones(100, 1);
  EXPECT_FALSE(solve_positive_definite(a, b));
}

}  // namespace
}  // namespace tarsier::linalg
