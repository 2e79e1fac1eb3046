// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// The inner loops of find_sift() (sift.h), compiled once for each instruction set from one source
// (sift_kernels.inl) and chosen at run time. They allocate nothing and call nothing of the standard
// library: no code that others use may be compiled for an instruction set of its own.
namespace tarsier::sfm {

// An image of floats; the row below begins `stride` floats further.
struct FloatPlane {
  const float* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;

  [[nodiscard]] const float* row(int y) const { return data + y * stride; }
};

inline constexpr int kMaxBlurRadius = 32;
inline constexpr int kBlurPadding = 64;  // floats before and behind a row
inline constexpr int kOrientations = 36;
inline constexpr int kDescriptorLength = 128;

struct SiftKernels {
  // Rows [from, to) of `in`, filtered in both directions with the symmetric kernel taps[0..radius],
  // mirrored at the borders: into `out`, and out - in into `difference` where it is not null. `line`:
  // width + 2 kBlurPadding floats.
  void (*blur)(const FloatPlane& in, const float* taps, int radius, int from, int to, float* out,
               float* difference, std::ptrdiff_t stride, float* line);

  // The x in [border, width - border) of row y where the middle plane is above `threshold` and no
  // less than its 26 neighbours, or below -threshold and no more: their number; `found` has room
  // for `width`.
  int (*extrema)(const FloatPlane& below, const FloatPlane& middle, const FloatPlane& above, int y,
                 int border, float threshold, int* found);

  // Magnitudes of the gradients around (x, y), by their direction: 36 bins of 10 degrees, x right
  // and y down, weighted by a Gaussian of 1.5 sigma; not smoothed.
  void (*orientations)(const FloatPlane& image, float x, float y, float sigma,
                       float histogram[kOrientations]);

  // The 4 x 4 histograms of 8 directions around (x, y) in the frame turned by the angle of which
  // cosine and sine are given; not normalised.
  void (*describe)(const FloatPlane& image, float x, float y, float sigma, float cosine, float sine,
                   float descriptor[kDescriptorLength]);
};

[[nodiscard]] const SiftKernels& sift_kernels();

// Null where the compiler's target has no such instructions.
[[nodiscard]] const SiftKernels* sift_baseline();
[[nodiscard]] const SiftKernels* sift_avx2();
[[nodiscard]] const SiftKernels* sift_avx512();

}  // namespace tarsier::sfm
