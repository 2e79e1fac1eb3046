// SPDX-License-Identifier: MIT
#define TARSIER_VECTOR_BYTES 16
#if defined(__aarch64__)
#define TARSIER_TILE_ROWS 6
#else
#define TARSIER_TILE_ROWS 4
#endif
#define TARSIER_BYTE_DOTS 0
#define TARSIER_NEAREST nearest_baseline
#include "tarsier/sfm/features/nearest.inl"
