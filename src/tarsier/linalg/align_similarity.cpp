// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>

namespace tarsier::linalg {

Eigen::Matrix4d align_similarity(const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b) {
  TARSIER_REQUIRE(a.cols() == b.cols() && a.cols() >= 3, "{} and {} points", a.cols(), b.cols());
  return Eigen::umeyama(a, b, true);
}

}  // namespace tarsier::linalg
