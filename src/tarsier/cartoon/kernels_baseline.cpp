// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/kernels.h"

#if defined(__aarch64__)
#include "tarsier/cartoon/simd_neon.h"
#else
#include "tarsier/cartoon/simd_portable.h"
#endif
#define TARSIER_KERNELS baseline_kernels
#include "tarsier/cartoon/kernels.inl"
