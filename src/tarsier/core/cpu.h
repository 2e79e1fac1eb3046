// SPDX-License-Identifier: MIT
#pragma once

#include <string_view>

namespace tarsier {

// Instruction sets for which the hot kernels are compiled, from one source. The program chooses one
// of them at run time.
enum class SimdLevel {
  // What the compiler's target guarantees (SSE2 on x86-64, NEON on arm64), or plain C++.
  kBaseline,
  kDotProducts,  // arm64: NEON with dot products of bytes (Cortex-A55, A76 and later: Pi 5)
  kSse41,
  kAvx2,
  kAvx512,  // F, BW, VL and VBMI (Ice Lake and later, Zen 4 and later)
};

// The best level that this processor and the environment variable TARSIER_SIMD (baseline, sse4.1,
// avx2, avx512) allow. The variable is read once.
[[nodiscard]] SimdLevel simd_level();

// The best level that this processor supports, whatever the environment says.
[[nodiscard]] SimdLevel hardware_simd_level();

// Limits simd_level() for the rest of the run (tests, benchmarks). It never exceeds the hardware.
// Must not be called while kernels run.
void limit_simd_level(SimdLevel level);

[[nodiscard]] std::string_view name_of(SimdLevel level);  // "baseline" is "NEON" on arm64

}  // namespace tarsier
