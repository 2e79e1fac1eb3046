// SPDX-License-Identifier: MIT
#include "tarsier/core/cpu.h"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <string_view>

#if defined(__aarch64__) && defined(__linux__)
#include <asm/hwcap.h>
#include <sys/auxv.h>
#endif

namespace tarsier {
namespace {

SimdLevel level_from_environment() {
  const SimdLevel best = hardware_simd_level();
  const char* requested = std::getenv("TARSIER_SIMD");
  if (requested == nullptr) return best;
  const std::string_view name(requested);
  if (name == "baseline") return SimdLevel::kBaseline;
  if (name == "sse4.1") return std::min(best, SimdLevel::kSse41);
  if (name == "avx2") return std::min(best, SimdLevel::kAvx2);
  return best;
}

std::atomic<SimdLevel>& current_level() {
  static std::atomic<SimdLevel> level{level_from_environment()};
  return level;
}

}  // namespace

SimdLevel hardware_simd_level() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512vbmi")) {
    return SimdLevel::kAvx512;
  }
  if (__builtin_cpu_supports("avx2")) return SimdLevel::kAvx2;
  if (__builtin_cpu_supports("sse4.1")) return SimdLevel::kSse41;
#elif defined(__aarch64__) && defined(__linux__)
  if ((getauxval(AT_HWCAP) & HWCAP_ASIMDDP) != 0) return SimdLevel::kDotProducts;
#endif
  return SimdLevel::kBaseline;
}

SimdLevel simd_level() { return current_level(); }

void limit_simd_level(SimdLevel level) { current_level() = std::min(level, hardware_simd_level()); }

std::string_view name_of(SimdLevel level) {
  switch (level) {
    case SimdLevel::kAvx512:
      return "AVX-512";
    case SimdLevel::kAvx2:
      return "AVX2";
    case SimdLevel::kSse41:
      return "SSE4.1";
    case SimdLevel::kDotProducts:
      return "NEON with dot products";
    case SimdLevel::kBaseline:
      break;
  }
#if defined(__aarch64__)
  return "NEON";
#else
  return "baseline";
#endif
}

}  // namespace tarsier
