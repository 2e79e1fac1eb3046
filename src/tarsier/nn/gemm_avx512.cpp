// SPDX-License-Identifier: MIT
#include "tarsier/nn/gemm.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 64
#define TARSIER_TILE_ROWS 8
#define TARSIER_GEMM gemm_avx512
#include "tarsier/nn/gemm.inl"
#else
const tarsier::nn::GemmKernels* tarsier::nn::gemm_avx512() { return nullptr; }
#endif
