// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

namespace tarsier::face::regression::test_support {

inline double mean_distance(const Eigen::Matrix2Xd& a, const Eigen::Matrix2Xd& b) {
  return (a - b).colwise().norm().mean();
}

}  // namespace tarsier::face::regression::test_support
