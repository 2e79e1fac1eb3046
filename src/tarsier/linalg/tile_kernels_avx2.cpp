// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_kernels.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 32
#define TARSIER_STRIPS 1
#define TARSIER_COLUMNS 4
#define TARSIER_TILE_KERNELS tile_kernels_avx2
#include "tarsier/linalg/tile_kernels.inl"
#else
const tarsier::linalg::TileKernels* tarsier::linalg::tile_kernels_avx2() { return nullptr; }
#endif
