// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace tarsier::linalg {

namespace {

using Eigen::MatrixXd;

}  // namespace

LeftSvd left_svd(const ConstMatrix& a) {
  const Eigen::JacobiSVD<MatrixXd> svd(a, Eigen::ComputeThinU);
  return {svd.matrixU(), svd.singularValues()};
}

MatrixXd orthonormal_basis(const ConstMatrix& a) {
  TARSIER_REQUIRE(a.rows() >= a.cols(), "{} columns of {} numbers", a.cols(), a.rows());
  return Eigen::HouseholderQR<MatrixXd>(a).householderQ() * MatrixXd::Identity(a.rows(), a.cols());
}

Eigen::Matrix4d align_similarity(const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b) {
  TARSIER_REQUIRE(a.cols() == b.cols() && a.cols() >= 3, "{} and {} points", a.cols(), b.cols());
  return Eigen::umeyama(a, b, true);
}

}  // namespace tarsier::linalg
