// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

// Compares a patch of one image with its projection into another by a plane: the inner loop of
// patch_match.h. Compiled for each instruction set from one source (patch_kernels.inl) and chosen
// at run time. Single precision; results differ in the last digits between instruction sets, never
// between runs or threads. Internal to this module.
namespace tarsier::sfm {

// A patch is 11x11 px, of which 32 are sampled: every second one, without the corners.
inline constexpr int kPatchSamples = 32;
inline constexpr int kPatchRadius = 5;  // px
inline constexpr float kMaxCost = 2.F;  // for an inverted patch, or none

// Grey levels with their neighbours. A word holds those at (x, y), (x + 1, y), (x, y + 1) and (x +
// 1, y + 1), lowest byte first, so that one load gives all values for bilinear interpolation.
struct GrayQuads {
  const std::uint32_t* data = nullptr;  // consecutive rows of `width` words each
  int width = 0;                        // px, at least 2
  int height = 0;
};

struct GrayImage {
  const std::uint8_t* data = nullptr;
  std::int64_t step = 0;  // bytes between rows
  int width = 0;
  int height = 0;
};

// The patch around a pixel p of the reference. Its weights w_i have the sum 1 and fall with the
// distance and with the difference in grey level from p (Tomasi and Manduchi, "Bilateral filtering
// for gray and color images", ICCV 1998): exp(-d_i^2 / (2 5^2) - (g_i - g_p)^2 / (2 51^2)).
struct Patch {
  alignas(64) float weight[kPatchSamples];
  alignas(64) float product[kPatchSamples];  // w_i (g_i - mean)
  float variance = 0;                        // sum of w_i (g_i - mean)^2, grey levels squared
};

struct PatchKernels {
  // Prepares the patch around (x, y); outside the image its border is replicated.
  void (*prepare)(const GrayImage& image, int x, int y, Patch& patch);
  // The same around a position between pixels, with samples `step` times as far apart.
  void (*prepare_interpolated)(const GrayQuads& image, float u, float v, float step, Patch& patch);

  // Returns 1 - sum of w_i (g_i - mean)(s_i - mean') / sqrt((var + e)(var' + e)): 0 for equal
  // patches, 1 for uncorrelated ones, at most kMaxCost. e = 2 squared grey levels represents
  // noise, so that uniform patches are uncorrelated with all others. s_i is the source at the pixel
  // to which `h` maps sample (dx, dy):
  //   u = (h[0] + h[1] dx + h[2] dy) / z, v = (h[3] + h[4] dx + h[5] dy) / z,
  //   z = h[6] + h[7] dx + h[8] dy.
  // Returns kMaxCost where the patch is behind the source or its centre outside. Otherwise the
  // source's border is replicated.
  float (*cost)(const Patch& patch, const GrayQuads& source, const float* h);
};

// The kernels for simd_level().
[[nodiscard]] const PatchKernels& patch_kernels();

// Null where the compiler's target lacks the instructions.
[[nodiscard]] const PatchKernels* patch_kernels_baseline();
[[nodiscard]] const PatchKernels* patch_kernels_avx2();
[[nodiscard]] const PatchKernels* patch_kernels_avx512();

}  // namespace tarsier::sfm
