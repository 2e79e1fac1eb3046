// SPDX-License-Identifier: MIT
#include "tarsier/linalg/gemm.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 64
#define TARSIER_TILE_ROWS 8
#define TARSIER_GEMM gemm_avx512
#include "tarsier/linalg/gemm.inl"
#else
const tarsier::linalg::GemmKernels* tarsier::linalg::gemm_avx512() { return nullptr; }
#endif
