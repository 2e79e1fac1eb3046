// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_kernels.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 64
#define TARSIER_STRIPS 3
#define TARSIER_COLUMNS 8
#define TARSIER_TILE_KERNELS tile_kernels_avx512
#include "tarsier/linalg/tile_kernels.inl"
#else
const tarsier::linalg::TileKernels* tarsier::linalg::tile_kernels_avx512() { return nullptr; }
#endif
