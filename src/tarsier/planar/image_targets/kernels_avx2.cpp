// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/kernels.h"

#if defined(__x86_64__)
#define TARSIER_TARGET_KERNELS kernels_avx2
#include "tarsier/planar/image_targets/kernels.inl"
#else
const tarsier::planar::image_targets::Kernels* tarsier::planar::image_targets::kernels_avx2() {
  return nullptr;
}
#endif
