// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// The matrix products of convolutions. They are compiled once for each instruction set from one
// source (gemm.inl) and selected at run time. Single precision. The order of summation depends only
// on the instruction set, never on threads.
namespace tarsier::linalg {

inline constexpr int kPanel = 48;  // columns of a panel
inline constexpr int kByteStep = 64;
inline constexpr int kMaxBytes = 65536;

struct GemmKernels {
  // out[m][0..kPanel) = sum over k of a[m * row + k * column] * b[k * b_stride + 0..kPanel)
  // for m < rows. `out` is rows x kPanel, dense.
  void (*panel)(int rows, int depth, const float* a, std::ptrdiff_t row, std::ptrdiff_t column,
                const float* b, std::ptrdiff_t b_stride, float* out);

  // The same, but row k of b begins at b + offsets[k], and a is dense, rows x depth: windows of a
  // map are read in place.
  void (*panel_at)(int rows, int depth, const float* a, const float* b,
                   const std::ptrdiff_t* offsets, float* out);

  // out[m * out_stride + n] += dot(a + m * a_stride, b + n * b_stride, length), m < rows, n <
  // columns.
  void (*dots)(int rows, int columns, int length, const float* a, std::ptrdiff_t a_stride,
               const float* b, std::ptrdiff_t b_stride, float* out, std::ptrdiff_t out_stride);

  // out[n] = dot(a, b + n * length, length) of integers from -127 to 127, n < rows. `length` is a
  // multiple of kByteStep and at most kMaxBytes. The result is the same with every instruction set.
  void (*byte_dots)(int rows, int length, const std::int8_t* a, const std::int8_t* b,
                    std::int32_t* out);
};

[[nodiscard]] const GemmKernels& gemm_kernels();

// Null if the compiler's target does not have these instructions.
[[nodiscard]] const GemmKernels* gemm_baseline();
[[nodiscard]] const GemmKernels* gemm_avx2();
[[nodiscard]] const GemmKernels* gemm_avx512();

}  // namespace tarsier::linalg
