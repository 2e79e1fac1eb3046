// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/patch_kernels.h"

#include "tarsier/core/cpu.h"

namespace tarsier::sfm {

const PatchKernels& patch_kernels() {
  const PatchKernels* chosen = nullptr;
  switch (simd_level()) {
    case SimdLevel::kAvx512:
      chosen = patch_kernels_avx512();
      break;
    case SimdLevel::kAvx2:
      chosen = patch_kernels_avx2();
      break;
    case SimdLevel::kSse41:
    case SimdLevel::kBaseline:
      break;
  }
  return chosen != nullptr ? *chosen : *patch_kernels_baseline();
}

}  // namespace tarsier::sfm
