// SPDX-License-Identifier: MIT
#include "tarsier/linalg/gemm.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 32
#define TARSIER_TILE_ROWS 4
#define TARSIER_GEMM gemm_avx2
#include "tarsier/linalg/gemm.inl"
#else
const tarsier::linalg::GemmKernels* tarsier::linalg::gemm_avx2() { return nullptr; }
#endif
