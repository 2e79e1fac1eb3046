// SPDX-License-Identifier: MIT
#define TARSIER_VECTOR_BYTES 16
#define TARSIER_STRIPS 1
#define TARSIER_COLUMNS 2
#define TARSIER_TILE_KERNELS tile_kernels_baseline
#include "tarsier/linalg/tile_kernels.inl"
