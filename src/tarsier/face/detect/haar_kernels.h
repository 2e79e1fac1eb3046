// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstdint>

// The inner loops of HaarCascade (haar_cascade.h), compiled for each instruction set from one
// source (haar_kernels.inl) and chosen at run time. They allocate nothing and call nothing from the
// standard library: shared code must not be compiled for a special instruction set.
namespace tarsier::face {

// Offsets of a rectangle's corners in an integral image, from the window's origin: s[0] - s[1] -
// s[2] + s[3].
using RectOffsets = std::array<std::int32_t, 4>;

// A node of a tree: compares a weighted sum of rectangles with a threshold.
struct HaarNode {
  std::array<RectOffsets, 3> rects{};
  std::array<float, 3> weights{};  // the third may be 0
  float threshold = 0;
  // Children by number in the tree, greater than the node's own; 0: a leaf with the value.
  std::int32_t below = 0;
  std::int32_t above = 0;
  float below_value = 0;
  float above_value = 0;
};

// Max number of nodes in a tree.
inline constexpr int kMaxHaarNodes = 8;

struct HaarTree {
  std::int32_t first = 0;  // node
  std::int32_t nodes = 0;
};

struct HaarStage {
  std::int32_t first = 0;  // tree
  std::int32_t trees = 0;
  float threshold = 0;  // a window passes if the sum of its leaves is not below this
};

// The kernels read beyond the last requested window and ignore the result. Rows need this number of
// additional elements.
inline constexpr int kHaarPadding = 16;

struct HaarKernels {
  // For `count` windows in a row: 1 / sqrt(area * sum of squares - square of the sum); 0 for
  // windows without contrast. `sum` and `squares`: integral images at the first window's origin.
  void (*norms)(const std::int32_t* sum, const std::int32_t* squares, const RectOffsets& inner,
                double area, int count, float* norms);

  // Moves those of windows[0..count), ascending, that pass a stage to the front; returns their
  // number.
  int (*pass)(const HaarStage& stage, const HaarTree* trees, const HaarNode* nodes,
              const std::int32_t* sum, const float* norms, std::int32_t* windows, int count);
};

[[nodiscard]] const HaarKernels& haar_kernels();

// Null if the compiler's target has no such instructions.
[[nodiscard]] const HaarKernels* haar_baseline();
[[nodiscard]] const HaarKernels* haar_avx2();
[[nodiscard]] const HaarKernels* haar_avx512();

}  // namespace tarsier::face
