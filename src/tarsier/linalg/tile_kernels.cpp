// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_kernels.h"

#include "tarsier/core/best_kernels.h"

namespace tarsier::linalg {

const TileKernels& tile_kernels() {
  return best_kernels(tile_kernels_baseline, tile_kernels_avx2, tile_kernels_avx512);
}

}  // namespace tarsier::linalg
