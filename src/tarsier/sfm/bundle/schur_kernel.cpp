// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/schur_kernel.h"

#include "tarsier/core/cpu.h"

#include <Eigen/Core>

namespace tarsier::sfm {
namespace {

using Matrix6x3 = Eigen::Matrix<double, 6, 3>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

void subtract(const double* scaled, const PoseBlock* blocks, int count) {
  const Matrix6x3 right = Eigen::Map<const Matrix6x3>(scaled);
  for (int k = 0; k < count; ++k)
    Eigen::Map<Matrix6>(blocks[k].block).noalias() -=
        Eigen::Map<const Matrix6x3>(blocks[k].mixed).lazyProduct(right.transpose());
}

}  // namespace

SubtractProducts subtract_products_baseline() { return subtract; }

SubtractProducts subtract_products() {
  const SubtractProducts avx2 =
      simd_level() >= SimdLevel::kAvx2 ? subtract_products_avx2() : nullptr;
  return avx2 != nullptr ? avx2 : subtract;
}

}  // namespace tarsier::sfm
