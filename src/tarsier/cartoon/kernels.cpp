// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/kernels.h"

#include "tarsier/core/best_kernels.h"

namespace tarsier::cartoon {

const Kernels& kernels() {
  return best_kernels(baseline_kernels, avx2_kernels, avx512_kernels, sse41_kernels);
}

}  // namespace tarsier::cartoon
