// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Eigenvalues>

namespace tarsier::linalg {

namespace {

using Eigen::MatrixXd;

template <class Solver>
SymmetricEigen decomposed(const Solver& solver) {
  TARSIER_REQUIRE(solver.info() == Eigen::Success, "the eigenvalues were not found");
  return {solver.eigenvalues(), solver.eigenvectors()};
}

}  // namespace

SymmetricEigen symmetric_eigen(const ConstMatrix& a) {
  TARSIER_REQUIRE(a.rows() == a.cols(), "a {} x {} matrix", a.rows(), a.cols());
  return decomposed(Eigen::SelfAdjointEigenSolver<MatrixXd>(a));
}

SymmetricEigen symmetric_eigen(const ConstMatrix& a, const ConstMatrix& b) {
  TARSIER_REQUIRE(a.rows() == a.cols() && b.rows() == b.cols() && a.rows() == b.rows(),
                  "a {} x {} and a {} x {} matrix", a.rows(), a.cols(), b.rows(), b.cols());
  return decomposed(Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd>(a, b));
}

}  // namespace tarsier::linalg
