// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/patch_kernels.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 64
#define TARSIER_PATCH_KERNELS patch_kernels_avx512
#include "tarsier/sfm/dense/patch_kernels.inl"
#else
const tarsier::sfm::PatchKernels* tarsier::sfm::patch_kernels_avx512() { return nullptr; }
#endif
