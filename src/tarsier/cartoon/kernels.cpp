// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/kernels.h"

#include "tarsier/core/cpu.h"

namespace tarsier::cartoon {

const Kernels& kernels() {
  const Kernels* chosen = nullptr;
  switch (simd_level()) {
    case SimdLevel::kAvx512:
      chosen = avx512_kernels();
      break;
    case SimdLevel::kAvx2:
      chosen = avx2_kernels();
      break;
    case SimdLevel::kSse41:
      chosen = sse41_kernels();
      break;
    case SimdLevel::kBaseline:
      break;
  }
  return chosen != nullptr ? *chosen : *baseline_kernels();
}

}  // namespace tarsier::cartoon
