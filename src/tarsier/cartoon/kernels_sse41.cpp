// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/kernels.h"

#if defined(__x86_64__)
#define TARSIER_SSE41
#include "tarsier/cartoon/simd_x86.h"
#define TARSIER_KERNELS sse41_kernels
#include "tarsier/cartoon/kernels.inl"
#else
const tarsier::cartoon::Kernels* tarsier::cartoon::sse41_kernels() { return nullptr; }
#endif
