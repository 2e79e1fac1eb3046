// SPDX-License-Identifier: MIT
#include "tarsier/linalg/gemm.h"

#include "tarsier/core/cpu.h"

namespace tarsier::linalg {

const GemmKernels& gemm_kernels() {
  const GemmKernels* chosen = nullptr;
  switch (simd_level()) {
    case SimdLevel::kAvx512:
      chosen = gemm_avx512();
      break;
    case SimdLevel::kAvx2:
      chosen = gemm_avx2();
      break;
    case SimdLevel::kSse41:
    case SimdLevel::kBaseline:
      break;
  }
  return chosen != nullptr ? *chosen : *gemm_baseline();
}

}  // namespace tarsier::linalg
