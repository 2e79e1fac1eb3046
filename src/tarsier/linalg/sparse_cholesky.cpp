// SPDX-License-Identifier: MIT
#include "tarsier/linalg/sparse_cholesky.h"

#include "tarsier/core/require.h"

#include <Eigen/SparseCholesky>

namespace tarsier::linalg {

struct SparseCholesky::Factor {
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Upper> solver;
};

SparseCholesky::SparseCholesky() : factor_(std::make_unique<Factor>()) {}
SparseCholesky::~SparseCholesky() = default;
SparseCholesky::SparseCholesky(SparseCholesky&&) noexcept = default;
SparseCholesky& SparseCholesky::operator=(SparseCholesky&&) noexcept = default;

void SparseCholesky::analyze(const Eigen::SparseMatrix<double>& a) {
  TARSIER_REQUIRE(a.rows() == a.cols(), "a {} x {} matrix", a.rows(), a.cols());
  factor_->solver.analyzePattern(a);
}

bool SparseCholesky::factorize(const Eigen::SparseMatrix<double>& a) {
  factor_->solver.factorize(a);
  return factor_->solver.info() == Eigen::Success;
}

Eigen::VectorXd SparseCholesky::solve(const Eigen::VectorXd& b) const {
  return factor_->solver.solve(b);
}

}  // namespace tarsier::linalg
