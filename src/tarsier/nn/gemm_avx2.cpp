// SPDX-License-Identifier: MIT
#include "tarsier/nn/gemm.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 32
#define TARSIER_TILE_ROWS 4
#define TARSIER_GEMM gemm_avx2
#include "tarsier/nn/gemm.inl"
#else
const tarsier::nn::GemmKernels* tarsier::nn::gemm_avx2() { return nullptr; }
#endif
