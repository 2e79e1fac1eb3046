// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/nearest.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 32
#define TARSIER_TILE_ROWS 4
#define TARSIER_BYTE_DOTS 0
#define TARSIER_NEAREST nearest_avx2
#include "tarsier/sfm/features/nearest.inl"
#else
const tarsier::sfm::NearestKernel* tarsier::sfm::nearest_avx2() { return nullptr; }
#endif
