// SPDX-License-Identifier: MIT
#define TARSIER_VECTOR_BYTES 16
#if defined(__aarch64__)
#define TARSIER_TILE_ROWS 8
#else
#define TARSIER_TILE_ROWS 4
#endif
#define TARSIER_GEMM gemm_baseline
#include "tarsier/linalg/gemm.inl"
