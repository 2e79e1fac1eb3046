// SPDX-License-Identifier: MIT
#include "tarsier/linalg/decompositions.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace tarsier::linalg {
namespace {

using Eigen::MatrixXd;

MatrixXd drawn(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  Rng rng(seed);
  MatrixXd result(rows, columns);
  for (Eigen::Index i = 0; i < result.size(); ++i) result.data()[i] = rng.normal();
  return result;
}

MatrixXd positive(Eigen::Index n, std::uint64_t seed) {
  const MatrixXd a = drawn(n, n, seed);
  return a * a.transpose() + MatrixXd::Identity(n, n);
}

TEST(Decompositions, SolvesOneAndSeveralRightHandSides) {
  const MatrixXd a = positive(9, 1);
  const MatrixXd general = drawn(9, 9, 2);
  for (const int columns : {1, 4}) {
    const MatrixXd x = drawn(9, columns, 3);
    EXPECT_LT((Cholesky(a).solve(a * x) - x).norm(), 1e-10);
    EXPECT_LT((solve_symmetric(a, a * x) - x).norm(), 1e-10);
    EXPECT_LT((solve_symmetric(-a, a * x) + x).norm(), 1e-10);
    EXPECT_LT((solve_general(general, general * x) - x).norm(), 1e-10);
  }
}

TEST(Decompositions, OnlyTheLowerTriangleIsRead) {
  const MatrixXd a = positive(6, 4);
  MatrixXd half = a;
  half.triangularView<Eigen::StrictlyUpper>().setConstant(std::nan(""));
  const MatrixXd x = drawn(6, 2, 5);
  EXPECT_LT((Cholesky(half).solve(a * x) - x).norm(), 1e-10);
  EXPECT_LT((solve_symmetric(half, a * x) - x).norm(), 1e-10);
  EXPECT_LT((symmetric_eigen(half).values - symmetric_eigen(a).values).norm(), 1e-10);
}

TEST(Decompositions, CholeskyDetectsIndefiniteMatrices) {
  const MatrixXd a = positive(5, 6);
  const Cholesky factor(a);
  ASSERT_TRUE(factor.ok());
  EXPECT_LT((factor.lower() * factor.lower().transpose() - a).norm(), 1e-10);
  EXPECT_FALSE(Cholesky(-a).ok());
  EXPECT_FALSE(Cholesky().ok());
  EXPECT_THROW(Cholesky(drawn(3, 4, 1)), std::invalid_argument);
}

TEST(Decompositions, EigenvectorsAreOrthonormalAndAscending) {
  const MatrixXd a = positive(8, 7);
  const SymmetricEigen eigen = symmetric_eigen(a);
  EXPECT_LT((a * eigen.vectors - eigen.vectors * eigen.values.asDiagonal()).norm(), 1e-9);
  EXPECT_LT((eigen.vectors.transpose() * eigen.vectors - MatrixXd::Identity(8, 8)).norm(), 1e-10);
  for (Eigen::Index i = 1; i < 8; ++i) EXPECT_LE(eigen.values[i - 1], eigen.values[i]);

  const MatrixXd b = positive(8, 8);
  const SymmetricEigen pencil = symmetric_eigen(a, b);
  EXPECT_LT((a * pencil.vectors - b * pencil.vectors * pencil.values.asDiagonal()).norm(), 1e-9);
  EXPECT_LT((pencil.vectors.transpose() * b * pencil.vectors - MatrixXd::Identity(8, 8)).norm(),
            1e-10);
  EXPECT_THROW((void)symmetric_eigen(MatrixXd::Constant(3, 3, std::nan(""))),
               std::invalid_argument);
}

TEST(Decompositions, LeftSvdAndBasisSpanTheColumns) {
  const MatrixXd a = drawn(12, 4, 9);
  const LeftSvd svd = left_svd(a);
  ASSERT_EQ(svd.u.cols(), 4);
  // A A^T = U values^2 U^T.
  const MatrixXd square = svd.u * svd.values.cwiseAbs2().asDiagonal() * svd.u.transpose();
  EXPECT_LT((square - a * a.transpose()).norm(), 1e-9);
  for (Eigen::Index i = 1; i < 4; ++i) EXPECT_GE(svd.values[i - 1], svd.values[i]);

  const MatrixXd q = orthonormal_basis(a);
  EXPECT_LT((q.transpose() * q - MatrixXd::Identity(4, 4)).norm(), 1e-10);
  EXPECT_LT((q * (q.transpose() * a) - a).norm(), 1e-10);
}

}  // namespace
}  // namespace tarsier::linalg
