// SPDX-License-Identifier: MIT
#pragma once

namespace tarsier::sfm {

// A block of the equations of two poses (6 x 6, column by column), and the second derivatives by the first of them and a
// point (6 x 3, column by column).
struct PoseBlock {
  const double* mixed = nullptr;
  double* block = nullptr;
};

// block -= mixed scaled^T for so many blocks; scaled: 6 x 3, column by column. The inner loop of the Schur complement. All
// kernels give the same numbers, to the last bit.
using SubtractProducts = void (*)(const double* scaled, const PoseBlock* blocks, int count);

// The fastest one of this processor.
[[nodiscard]] SubtractProducts subtract_products();

// Of single instruction sets; null where it was not compiled.
[[nodiscard]] SubtractProducts subtract_products_baseline();
[[nodiscard]] SubtractProducts subtract_products_avx2();

}  // namespace tarsier::sfm
