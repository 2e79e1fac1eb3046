// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/kernels.h"

#if defined(__x86_64__)
#define TARSIER_AVX512
#include "tarsier/cartoon/simd_x86.h"
//
#include "tarsier/cartoon/bilateral_vnni.h"
#define TARSIER_KERNELS avx512_kernels
#include "tarsier/cartoon/kernels.inl"
#else
const tarsier::cartoon::Kernels* tarsier::cartoon::avx512_kernels() { return nullptr; }
#endif
