// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/nearest.h"

#if defined(__aarch64__)
#define TARSIER_VECTOR_BYTES 16
#define TARSIER_TILE_ROWS 8
#define TARSIER_BYTE_DOTS 1
#define TARSIER_NEAREST nearest_dotprod
#include "tarsier/sfm/features/nearest.inl"
#else
const tarsier::sfm::NearestKernel* tarsier::sfm::nearest_dotprod() { return nullptr; }
#endif
