// SPDX-License-Identifier: MIT
// Compiled with TARSIER_VECTOR_BYTES (16, 32 or 64) and TARSIER_HAAR (name of the function that
// returns the kernels).
#include "tarsier/face/detect/haar_kernels.h"

namespace tarsier::face {
namespace {

constexpr int kLanes = TARSIER_VECTOR_BYTES / 4;

using Floats __attribute__((vector_size(TARSIER_VECTOR_BYTES))) = float;
using Ints __attribute__((vector_size(TARSIER_VECTOR_BYTES))) = std::int32_t;
using Unsigned __attribute__((vector_size(TARSIER_VECTOR_BYTES))) = std::uint32_t;
using Doubles __attribute__((vector_size(2 * TARSIER_VECTOR_BYTES))) = double;

template <typename T>
T loaded(const void* from) {
  T value;
  __builtin_memcpy(&value, from, sizeof(value));
  return value;
}

// Unsigned, since lanes behind the last window may hold any numbers and overflow.
Floats rect_sums(const std::int32_t* sum, const RectOffsets& at) {
  const Unsigned sums = loaded<Unsigned>(sum + at[0]) - loaded<Unsigned>(sum + at[1]) -
                        loaded<Unsigned>(sum + at[2]) + loaded<Unsigned>(sum + at[3]);
  return __builtin_convertvector(__builtin_convertvector(sums, Ints), Floats);
}

Floats values_of(const HaarNode& node, const std::int32_t* sum, Floats norms) {
  Floats values = node.weights[0] * rect_sums(sum, node.rects[0]) +
                  node.weights[1] * rect_sums(sum, node.rects[1]);
  if (node.weights[2] != 0) values += node.weights[2] * rect_sums(sum, node.rects[2]);
  return values * norms;
}

// Evaluates all nodes of a tree from the last to the root: children have higher indices than their
// parent.
Floats leaves_of(const HaarTree& tree, const HaarNode* nodes, const std::int32_t* sum,
                 Floats norms) {
  Floats leaves[kMaxHaarNodes];
  for (std::int32_t k = tree.nodes - 1; k >= 0; --k) {
    const HaarNode& node = nodes[tree.first + k];
    const Floats below = node.below > 0 ? leaves[node.below] : node.below_value - Floats{};
    const Floats above = node.above > 0 ? leaves[node.above] : node.above_value - Floats{};
    leaves[k] = values_of(node, sum, norms) < node.threshold ? below : above;
  }
  return leaves[0];
}

void norms(const std::int32_t* sum, const std::int32_t* squares, const RectOffsets& inner,
           double area, int count, float* result) {
  for (int i = 0; i < count; ++i) {
    const std::int32_t total =
        sum[i + inner[0]] - sum[i + inner[1]] - sum[i + inner[2]] + sum[i + inner[3]];
    // Sums of squares may exceed the range of a signed number.
    const auto square = static_cast<std::uint32_t>(squares[i + inner[0]]) -
                        static_cast<std::uint32_t>(squares[i + inner[1]]) -
                        static_cast<std::uint32_t>(squares[i + inner[2]]) +
                        static_cast<std::uint32_t>(squares[i + inner[3]]);
    const double contrast = area * static_cast<double>(square) - static_cast<double>(total) * total;
    const auto norm = static_cast<float>(1 / __builtin_sqrt(contrast > 0 ? contrast : 1));
    result[i] = contrast > 0 && area * static_cast<double>(norm) < 0.1 ? norm : 0.0F;
  }
}

// Keeps the windows that pass the stage. A vector costs little more than a single window. Each
// vector begins at the next remaining window; lanes of rejected windows are ignored.
int pass(const HaarStage& stage, const HaarTree* trees, const HaarNode* nodes,
         const std::int32_t* sum, const float* norms, std::int32_t* windows, int count) {
  int kept = 0;
  for (int k = 0; k < count;) {
    const std::int32_t first = windows[k];
    const auto norm = loaded<Floats>(norms + first);
    Doubles total{};
    for (std::int32_t t = 0; t < stage.trees; ++t)
      total += __builtin_convertvector(leaves_of(trees[stage.first + t], nodes, sum + first, norm),
                                       Doubles);
    const auto passes = total >= static_cast<double>(stage.threshold);
    for (; k < count && windows[k] < first + kLanes; ++k) {
      if (passes[windows[k] - first] != 0) windows[kept++] = windows[k];
    }
  }
  return kept;
}

constexpr HaarKernels kKernels{norms, pass};

}  // namespace

const HaarKernels* TARSIER_HAAR() { return &kKernels; }

}  // namespace tarsier::face
