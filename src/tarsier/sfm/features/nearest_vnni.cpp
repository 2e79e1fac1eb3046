// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/nearest.h"

#if defined(__x86_64__)
#define TARSIER_VECTOR_BYTES 64
#define TARSIER_TILE_ROWS 8
#define TARSIER_BYTE_DOTS 1
#define TARSIER_NEAREST vnni_kernel
namespace tarsier::sfm {
const NearestKernel* vnni_kernel();
}
#include "tarsier/sfm/features/nearest.inl"

const tarsier::sfm::NearestKernel* tarsier::sfm::nearest_vnni() {
  return __builtin_cpu_supports("avx512vnni") != 0 ? vnni_kernel() : nullptr;
}
#else
const tarsier::sfm::NearestKernel* tarsier::sfm::nearest_vnni() { return nullptr; }
#endif
