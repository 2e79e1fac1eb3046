// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/kernels.h"

#if defined(__x86_64__)
#define TARSIER_AVX2
#include "tarsier/cartoon/simd_x86.h"
#define TARSIER_KERNELS avx2_kernels
#include "tarsier/cartoon/kernels.inl"
#else
const tarsier::cartoon::Kernels* tarsier::cartoon::avx2_kernels() { return nullptr; }
#endif
