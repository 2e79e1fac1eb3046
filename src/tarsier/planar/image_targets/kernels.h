// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstdint>

// The inner loops of target detection, compiled once for each instruction set from kernels.inl.
namespace tarsier::planar::image_targets {

inline constexpr int kDescriptorSize = 128;  // 4x4 cells of 8 directions
inline constexpr int kSketchWords = 4;       // 256 bits
// Side of the patch from which a descriptor is computed.
inline constexpr int kSampleSide = 20;

using Sketch = std::array<std::uint64_t, kSketchWords>;

// 16 sketches, word by word. The last block is padded with copies of its first sketch.
struct alignas(64) SketchBlock {
  std::uint64_t words[kSketchWords][16];
};

inline constexpr int kDirections = 36;      // bins, starting at -pi
inline constexpr int kDirectionRadius = 9;  // px

struct Kernels {
  // out[x] = 16 times the determinant of the Hessian, from second differences over 2 px. rows[0..4]
  // are the rows y-2, y-1, y, y+1, y+2 (only 0, 2 and 4 are read), readable from x = -2 to n + 1.
  void (*hessian_row)(const std::uint8_t* const rows[5], int n, int* out);

  // For x = 1 .. n - 2: out[x] is 1 if here[x] is at least `bound` and a maximum of its 3x3
  // neighbourhood (the first one of equal values), otherwise 0.
  void (*maxima)(const int* above, const int* here, const int* below, int n, int bound,
                 std::uint8_t* out);

  // Bilinear samples at (x, y) + (dx, dy) column + (-dy, dx) row for kSampleSide rows and columns,
  // in 16.16 fixed point. All samples must lie inside.
  void (*sample)(const std::uint8_t* image, int stride, int x, int y, int dx, int dy, float* out);

  // Pools samples into the 4x4x8 gradients, not normalised.
  void (*pool)(const float* samples, float* out);

  // Adds the gradients around a pixel, with Gaussian weights, to a histogram of orientations.
  void (*directions)(const std::uint8_t* center, int stride, float* histogram);

  // Finds the sketches of `blocks` (see SketchBlock) that differ from `one` in at most `bound`
  // bits. Writes their indices and distances, in order; at most `room`. Returns the number.
  int (*search)(const Sketch& one, const SketchBlock* blocks, int n, int bound, int room,
                std::int32_t* index, std::uint16_t* distance);

  // Sum of squared differences of two descriptors.
  int (*distance)(const std::uint8_t* a, const std::uint8_t* b);
};

[[nodiscard]] const Kernels& kernels();

// Null if this build or processor does not support them.
[[nodiscard]] const Kernels* kernels_baseline();
[[nodiscard]] const Kernels* kernels_avx2();
[[nodiscard]] const Kernels* kernels_avx512();

}  // namespace tarsier::planar::image_targets
