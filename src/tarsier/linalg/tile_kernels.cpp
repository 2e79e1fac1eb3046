// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_kernels.h"

#include "tarsier/core/cpu.h"

namespace tarsier::linalg {

const TileKernels& tile_kernels() {
  const TileKernels* kernels = nullptr;
  if (simd_level() >= SimdLevel::kAvx512) kernels = tile_kernels_avx512();
  if (kernels == nullptr && simd_level() >= SimdLevel::kAvx2) kernels = tile_kernels_avx2();
  return kernels != nullptr ? *kernels : *tile_kernels_baseline();
}

}  // namespace tarsier::linalg
