// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// The inner loops of find_sift() (sift.h), compiled for each instruction set from one source
// (sift_kernels.inl) and chosen at run time. They allocate nothing and do not call the standard
// library: code that is shared with other units must not be compiled for a special instruction set.
namespace tarsier::sfm {

// An image of floats; rows are `stride` floats apart.
struct FloatPlane {
  const float* data = nullptr;
  int width = 0;
  int height = 0;
  std::ptrdiff_t stride = 0;

  [[nodiscard]] const float* row(int y) const { return data + y * stride; }
};

inline constexpr int kMaxBlurRadius = 32;
inline constexpr int kBlurPadding = 64;  // floats before and after a row
inline constexpr int kOrientations = 36;
inline constexpr int kDescriptorLength = 128;

struct SiftKernels {
  // Filters rows [from, to) of `in` in both directions with the symmetric kernel taps[0..radius],
  // mirrored at the borders. Writes to `out`, and out - in to `difference` where it is not null.
  // `line`: scratch of width + 2 kBlurPadding floats.
  void (*blur)(const FloatPlane& in, const float* taps, int radius, int from, int to, float* out,
               float* difference, std::ptrdiff_t stride, float* line);

  // Finds the x in [border, width - border) of row y where the middle plane is above `threshold`
  // and no less than its 26 neighbours, or below -threshold and no more. Returns their number;
  // `found` has room for `width`.
  int (*extrema)(const FloatPlane& below, const FloatPlane& middle, const FloatPlane& above, int y,
                 int border, float threshold, int* found);

  // Histogram of gradient magnitudes around (x, y) by direction: 36 bins of 10 degrees, x right and
  // y down, weighted by a Gaussian of 1.5 sigma; not smoothed.
  void (*orientations)(const FloatPlane& image, float x, float y, float sigma,
                       float histogram[kOrientations]);

  // The 4 x 4 histograms of 8 directions around (x, y), in the frame rotated by the angle with this
  // cosine and sine; not normalised.
  void (*describe)(const FloatPlane& image, float x, float y, float sigma, float cosine, float sine,
                   float descriptor[kDescriptorLength]);
};

[[nodiscard]] const SiftKernels& sift_kernels();

// Null where the compiler's target lacks the instructions.
[[nodiscard]] const SiftKernels* sift_baseline();
[[nodiscard]] const SiftKernels* sift_avx2();
[[nodiscard]] const SiftKernels* sift_avx512();

}  // namespace tarsier::sfm
