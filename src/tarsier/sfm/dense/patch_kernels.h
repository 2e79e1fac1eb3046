// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

// How well a patch of one image agrees with a plane's image of it in another: the inner loop of
// patch_match.h, compiled once for each instruction set from one source (patch_kernels.inl) and chosen
// at run time. Single precision; results differ between instruction sets in the last digits, never
// between runs or threads. Internal to this module.
namespace tarsier::sfm {

// A patch is 11x11 px, of which 32 are looked at: every second one, without the corners.
inline constexpr int kPatchSamples = 32;
inline constexpr int kPatchRadius = 5;    // px
inline constexpr float kWorstCost = 2.F;  // of an opposite patch, or of none

// Grey levels with their neighbours: a word has those at (x, y), (x + 1, y), (x, y + 1) and
// (x + 1, y + 1), lowest byte first, so that one load gives what bilinear interpolation needs.
struct GrayQuads {
  const std::uint32_t* data = nullptr;  // rows one after the other, `width` words each
  int width = 0;                        // px, 2 or more
  int height = 0;
};

struct GrayImage {
  const std::uint8_t* data = nullptr;
  std::int64_t step = 0;  // bytes from row to row
  int width = 0;
  int height = 0;
};

// The patch around a pixel p of the reference: with weights w_i, sum 1, that fall with distance and
// with the difference of grey levels from that of p (Tomasi and Manduchi, "Bilateral filtering for
// gray and color images", ICCV 1998): exp(-d_i^2 / (2 5^2) - (g_i - g_p)^2 / (2 51^2)).
struct Patch {
  alignas(64) float weight[kPatchSamples];
  alignas(64) float product[kPatchSamples];  // w_i (g_i - mean)
  float variance = 0;                        // sum of w_i (g_i - mean)^2, grey levels squared
};

struct PatchKernels {
  // The patch around (x, y); outside of the image its border goes on.
  void (*prepare)(const GrayImage& image, int x, int y, Patch& patch);
  // The same around a place between pixels, its samples `step` times as far apart.
  void (*prepare_between)(const GrayQuads& image, float u, float v, float step, Patch& patch);

  // 1 - sum of w_i (g_i - mean)(s_i - mean') / sqrt((var + e)(var' + e)): 0 for the same, 1 for
  // nothing in common, kWorstCost at most. e = 2 squared grey levels stands for noise, so that flat
  // patches have nothing in common with anything. s_i is the source at the pixel that `h` maps
  // sample (dx, dy) to:
  //   u = (h[0] + h[1] dx + h[2] dy) / z, v = (h[3] + h[4] dx + h[5] dy) / z,
  //   z = h[6] + h[7] dx + h[8] dy.
  // kWorstCost where the patch is behind the source or its middle outside; its border goes on.
  float (*cost)(const Patch& patch, const GrayQuads& source, const float* h);
};

// Of simd_level().
[[nodiscard]] const PatchKernels& patch_kernels();

// Null where the compiler's target has no such instructions.
[[nodiscard]] const PatchKernels* patch_kernels_baseline();
[[nodiscard]] const PatchKernels* patch_kernels_avx2();
[[nodiscard]] const PatchKernels* patch_kernels_avx512();

}  // namespace tarsier::sfm
