// SPDX-License-Identifier: MIT
#pragma once

#include <string_view>

namespace tarsier {

// Instruction sets that the hot kernels are compiled for, from one source; which one runs is chosen
// at run time.
enum class SimdLevel {
  kBaseline,  // what the compiler's target guarantees (SSE2 on x86-64, NEON on arm64), or plain C++
  kSse41,
  kAvx2,
  kAvx512,  // F, BW, VL and VBMI (Ice Lake and later, Zen 4 and later)
};

// The best level that this processor and the environment variable TARSIER_SIMD (baseline, sse4.1,
// avx2, avx512) allow. Read once.
[[nodiscard]] SimdLevel simd_level();

// The best level of this processor alone.
[[nodiscard]] SimdLevel hardware_simd_level();

// Caps simd_level() from now on (tests, benchmarks). Never above the hardware. Not for use while
// kernels run.
void limit_simd_level(SimdLevel level);

[[nodiscard]] std::string_view name_of(SimdLevel level);  // "baseline" is "NEON" on arm64

}  // namespace tarsier
