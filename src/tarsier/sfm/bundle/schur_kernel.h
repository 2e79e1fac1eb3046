// SPDX-License-Identifier: MIT
#pragma once

namespace tarsier::sfm {

// A block of the equations of two poses (6 x 6, column-major), and the mixed second derivatives of
// the first pose and a point (6 x 3, column-major).
struct PoseBlock {
  const double* mixed = nullptr;
  double* block = nullptr;
};

// Computes block -= mixed scaled^T for `count` blocks; scaled: 6 x 3, column-major. The inner loop
// of the Schur complement. All kernels give bit-identical results.
using SubtractProducts = void (*)(const double* scaled, const PoseBlock* blocks, int count);

// The fastest kernel for this processor.
[[nodiscard]] SubtractProducts subtract_products();

// Kernels of single instruction sets; null where not compiled.
[[nodiscard]] SubtractProducts subtract_products_baseline();
[[nodiscard]] SubtractProducts subtract_products_avx2();

}  // namespace tarsier::sfm
