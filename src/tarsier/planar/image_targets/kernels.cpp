// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/kernels.h"

#include "tarsier/core/cpu.h"

namespace tarsier::planar::image_targets {

const Kernels& kernels() {
  const Kernels* chosen = nullptr;
  switch (simd_level()) {
    case SimdLevel::kAvx512:
      chosen = kernels_avx512();
      break;
    case SimdLevel::kAvx2:
      chosen = kernels_avx2();
      break;
    case SimdLevel::kSse41:
    case SimdLevel::kBaseline:
      break;
  }
  return chosen != nullptr ? *chosen : *kernels_baseline();
}

}  // namespace tarsier::planar::image_targets
