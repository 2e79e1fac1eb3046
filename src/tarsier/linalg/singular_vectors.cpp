// SPDX-License-Identifier: MIT
#include "tarsier/linalg/decompositions.h"

#include <Eigen/SVD>

namespace tarsier::linalg {

LeftSvd left_svd(const ConstMatrix& a) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(a, Eigen::ComputeThinU);
  return {svd.matrixU(), svd.singularValues()};
}

}  // namespace tarsier::linalg
