// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstdint>

// The inner loops of HaarCascade (haar_cascade.h), compiled once for each instruction set from one source
// (haar_kernels.inl) and chosen at run time. They allocate nothing and call nothing of the standard library: no code
// that others use may be compiled for an instruction set of its own.
namespace tarsier::face {

// Where a sum over a rectangle is in an integral image, from the window's origin: s[0] - s[1] - s[2] + s[3].
using RectOffsets = std::array<std::int32_t, 4>;

// A node of a tree: a weighted sum of rectangles is compared with a threshold.
struct HaarNode {
  std::array<RectOffsets, 3> rects{};
  std::array<float, 3> weights{};  // the third may be 0
  float threshold = 0;
  // Children by number in the tree, above the node's own; 0: a leaf with the value.
  std::int32_t below = 0;
  std::int32_t above = 0;
  float below_value = 0;
  float above_value = 0;
};

// Most nodes of a tree.
inline constexpr int kMaxHaarNodes = 8;

struct HaarTree {
  std::int32_t first = 0;  // node
  std::int32_t nodes = 0;
};

struct HaarStage {
  std::int32_t first = 0;  // tree
  std::int32_t trees = 0;
  float threshold = 0;  // a window goes on where the sum of its leaves is not below
};

// Windows past the last one that is asked for are read, and ignored: so many numbers behind a row are needed.
inline constexpr int kHaarPadding = 16;

struct HaarKernels {
  // Of `count` windows in a row: 1 / sqrt(area * sum of squares - square of the sum); 0 for those without contrast. `sum`
  // and `squares`: integral images at the first window's origin.
  void (*norms)(const std::int32_t* sum, const std::int32_t* squares, const RectOffsets& inner,
                double area, int count, float* norms);

  // Those of windows[0..count), ascending, that pass a stage: they are moved to the front; their number.
  int (*pass)(const HaarStage& stage, const HaarTree* trees, const HaarNode* nodes,
              const std::int32_t* sum, const float* norms, std::int32_t* windows, int count);
};

[[nodiscard]] const HaarKernels& haar_kernels();

// Null where the compiler's target has no such instructions.
[[nodiscard]] const HaarKernels* haar_baseline();
[[nodiscard]] const HaarKernels* haar_avx2();
[[nodiscard]] const HaarKernels* haar_avx512();

}  // namespace tarsier::face
