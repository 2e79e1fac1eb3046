// SPDX-License-Identifier: MIT
#include "tarsier/linalg/decompositions.h"

#include "tarsier/core/require.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace tarsier::linalg {

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// A single right-hand side has a faster method; both are exact to rounding, but round differently.
template <class Solver>
MatrixXd solved(const Solver& solver, const ConstMatrix& b) {
  if (b.cols() == 1) return VectorXd(solver.solve(VectorXd(b)));
  return solver.solve(b);
}

void require_square(const ConstMatrix& a, const ConstMatrix& b) {
  TARSIER_REQUIRE(a.rows() == a.cols() && a.rows() == b.rows(), "a {} x {} matrix and {} rows",
                  a.rows(), a.cols(), b.rows());
}

}  // namespace

bool Cholesky::compute(const ConstMatrix& a) {
  TARSIER_REQUIRE(a.rows() == a.cols(), "a {} x {} matrix", a.rows(), a.cols());
  factor_ = a;
  const Eigen::LLT<Eigen::Ref<MatrixXd>> in_place(factor_);
  ok_ = in_place.info() == Eigen::Success;
  return ok_;
}

MatrixXd Cholesky::solve(const ConstMatrix& b) const {
  require_square(factor_, b);
  if (b.cols() == 1) {
    VectorXd x = b;
    factor_.triangularView<Eigen::Lower>().solveInPlace(x);
    factor_.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
    return x;
  }
  MatrixXd x = b;
  factor_.triangularView<Eigen::Lower>().solveInPlace(x);
  factor_.transpose().triangularView<Eigen::Upper>().solveInPlace(x);
  return x;
}

MatrixXd Cholesky::lower() const { return factor_.triangularView<Eigen::Lower>(); }

MatrixXd solve_symmetric(const ConstMatrix& a, const ConstMatrix& b) {
  require_square(a, b);
  return solved(Eigen::LDLT<MatrixXd>(a), b);
}

MatrixXd solve_general(const ConstMatrix& a, const ConstMatrix& b) {
  require_square(a, b);
  return solved(Eigen::PartialPivLU<MatrixXd>(a), b);
}

}  // namespace tarsier::linalg
