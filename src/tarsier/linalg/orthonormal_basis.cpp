// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/QR>

namespace tarsier::linalg {

using Eigen::MatrixXd;

MatrixXd orthonormal_basis(const ConstMatrix& a) {
  TARSIER_REQUIRE(a.rows() >= a.cols(), "{} columns of {} numbers", a.cols(), a.rows());
  return Eigen::HouseholderQR<MatrixXd>(a).householderQ() * MatrixXd::Identity(a.rows(), a.cols());
}

}  // namespace tarsier::linalg
