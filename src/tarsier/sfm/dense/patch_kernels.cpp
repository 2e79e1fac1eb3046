// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/patch_kernels.h"

#include "tarsier/core/best_kernels.h"

namespace tarsier::sfm {

const PatchKernels& patch_kernels() {
  return best_kernels(patch_kernels_baseline, patch_kernels_avx2, patch_kernels_avx512);
}

}  // namespace tarsier::sfm
