// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/cpu.h"

namespace tarsier {

// Chooses among kernels compiled for several instruction sets: the best one that simd_level()
// allows. Each function returns null where the build has no code for its instruction set. The
// baseline always exists.
template <class Kernels>
[[nodiscard]] const Kernels& best_kernels(const Kernels* (*baseline)(), const Kernels* (*avx2)(),
                                          const Kernels* (*avx512)(),
                                          const Kernels* (*sse41)() = nullptr) {
  const SimdLevel level = simd_level();
  const Kernels* chosen = nullptr;
  if (level >= SimdLevel::kAvx512) chosen = avx512();
  if (chosen == nullptr && level >= SimdLevel::kAvx2) chosen = avx2();
  if (chosen == nullptr && level >= SimdLevel::kSse41 && sse41 != nullptr) chosen = sse41();
  return chosen != nullptr ? *chosen : *baseline();
}

}  // namespace tarsier
