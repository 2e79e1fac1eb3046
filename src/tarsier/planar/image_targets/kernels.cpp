// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/kernels.h"

#include "tarsier/core/best_kernels.h"

namespace tarsier::planar::image_targets {

const Kernels& kernels() { return best_kernels(kernels_baseline, kernels_avx2, kernels_avx512); }

}  // namespace tarsier::planar::image_targets
