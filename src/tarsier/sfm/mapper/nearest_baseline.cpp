// SPDX-License-Identifier: MIT
#define TARSIER_VECTOR_BYTES 16
#define TARSIER_TILE_ROWS 4
#define TARSIER_BYTE_DOTS 0
#define TARSIER_NEAREST nearest_baseline
#include "tarsier/sfm/mapper/nearest.inl"
