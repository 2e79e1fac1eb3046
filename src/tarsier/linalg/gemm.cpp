// SPDX-License-Identifier: MIT
#include "tarsier/linalg/gemm.h"

#include "tarsier/core/best_kernels.h"

namespace tarsier::linalg {

const GemmKernels& gemm_kernels() { return best_kernels(gemm_baseline, gemm_avx2, gemm_avx512); }

}  // namespace tarsier::linalg
