// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/sift_kernels.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 64
#define TARSIER_SIFT sift_avx512
#include "tarsier/sfm/features/sift_kernels.inl"
#else
const tarsier::sfm::SiftKernels* tarsier::sfm::sift_avx512() { return nullptr; }
#endif
