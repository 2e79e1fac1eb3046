// SPDX-License-Identifier: MIT
// Included once for each instruction set. The including file defines TARSIER_VECTOR_BYTES (16, 32,
// 64), TARSIER_TILE_ROWS (rows of a register tile) and TARSIER_GEMM (the function's name).
#include "tarsier/linalg/gemm.h"

#include <cstring>

namespace tarsier::linalg {
namespace {

using Vector = float __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
constexpr int kLanes = TARSIER_VECTOR_BYTES / 4;
constexpr int kTileVectors = kPanel / kLanes < 3 ? kPanel / kLanes : 3;
constexpr int kTileColumns = kTileVectors * kLanes;
static_assert(kPanel % kTileColumns == 0);

inline Vector load(const float* p) {
  Vector v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline void store(float* p, Vector v) { std::memcpy(p, &v, sizeof v); }

// The left factor: element (m, k) is data[m * row + k * column].
struct Left {
  const float* data;
  std::ptrdiff_t row;
  std::ptrdiff_t column;
};

// Start of row k of the right factor.
struct Dense {
  const float* data;
  std::ptrdiff_t stride;
  const float* operator()(int k) const { return data + k * stride; }
};
struct Scattered {
  const float* data;
  const std::ptrdiff_t* offsets;
  const float* operator()(int k) const { return data + offsets[k]; }
};

// A tile of Rows x kTileColumns stays in registers during the loop over the depth.
template <int Rows, typename Right>
inline void tile(int depth, const Left& left, const Right& right, std::ptrdiff_t first,
                 float* out) {
  Vector sum[Rows][kTileVectors] = {};
  const float* a = left.data;
  for (int k = 0; k < depth; ++k) {
    const float* b = right(k) + first;
    Vector line[kTileVectors];
    for (int v = 0; v < kTileVectors; ++v) line[v] = load(b + v * kLanes);
    for (int m = 0; m < Rows; ++m) {
      const float factor = a[m * left.row];
      for (int v = 0; v < kTileVectors; ++v) sum[m][v] += factor * line[v];
    }
    a += left.column;
  }
  for (int m = 0; m < Rows; ++m)
    for (int v = 0; v < kTileVectors; ++v) store(out + m * kPanel + v * kLanes, sum[m][v]);
}

template <int Rows, typename Right>
void rest(int rows, int depth, const Left& left, const Right& right, std::ptrdiff_t first,
          float* out) {
  if constexpr (Rows > 0) {
    if (rows == Rows)
      tile<Rows>(depth, left, right, first, out);
    else
      rest<Rows - 1>(rows, depth, left, right, first, out);
  }
}

template <typename Right>
void tiles(int rows, int depth, const Left& left, const Right& right, float* out) {
  for (int c = 0; c < kPanel; c += kTileColumns) {
    int m = 0;
    const auto below = [&] { return Left{left.data + m * left.row, left.row, left.column}; };
    for (; m + TARSIER_TILE_ROWS <= rows; m += TARSIER_TILE_ROWS)
      tile<TARSIER_TILE_ROWS>(depth, below(), right, c, out + m * kPanel + c);
    rest<TARSIER_TILE_ROWS - 1>(rows - m, depth, below(), right, c, out + m * kPanel + c);
  }
}

void panel(int rows, int depth, const float* a, std::ptrdiff_t row, std::ptrdiff_t column,
           const float* b, std::ptrdiff_t b_stride, float* out) {
  tiles(rows, depth, Left{a, row, column}, Dense{b, b_stride}, out);
}

void panel_at(int rows, int depth, const float* a, const float* b, const std::ptrdiff_t* offsets,
              float* out) {
  tiles(rows, depth, Left{a, depth, 1}, Scattered{b, offsets}, out);
}

inline float sum_of(Vector v) {
  float total = 0;
  for (int i = 0; i < kLanes; ++i) total += v[i];
  return total;
}

template <int Rows, int Columns>
inline void dot_tile(int length, const float* a, std::ptrdiff_t a_stride, const float* b,
                     std::ptrdiff_t b_stride, float* out, std::ptrdiff_t out_stride) {
  Vector sum[Rows][Columns] = {};
  int i = 0;
  for (; i + kLanes <= length; i += kLanes) {
    Vector right[Columns];
    for (int n = 0; n < Columns; ++n) right[n] = load(b + n * b_stride + i);
    for (int m = 0; m < Rows; ++m) {
      const Vector left = load(a + m * a_stride + i);
      for (int n = 0; n < Columns; ++n) sum[m][n] += left * right[n];
    }
  }
  for (int m = 0; m < Rows; ++m) {
    for (int n = 0; n < Columns; ++n) {
      float total = sum_of(sum[m][n]);
      for (int j = i; j < length; ++j) total += a[m * a_stride + j] * b[n * b_stride + j];
      out[m * out_stride + n] += total;
    }
  }
}

void dots(int rows, int columns, int length, const float* a, std::ptrdiff_t a_stride,
          const float* b, std::ptrdiff_t b_stride, float* out, std::ptrdiff_t out_stride) {
  int m = 0;
  for (; m + 4 <= rows; m += 4) {
    int n = 0;
    for (; n + 4 <= columns; n += 4)
      dot_tile<4, 4>(length, a + m * a_stride, a_stride, b + n * b_stride, b_stride,
                     out + m * out_stride + n, out_stride);
    for (; n < columns; ++n)
      dot_tile<4, 1>(length, a + m * a_stride, a_stride, b + n * b_stride, b_stride,
                     out + m * out_stride + n, out_stride);
  }
  for (; m < rows; ++m) {
    int n = 0;
    for (; n + 4 <= columns; n += 4)
      dot_tile<1, 4>(length, a + m * a_stride, a_stride, b + n * b_stride, b_stride,
                     out + m * out_stride + n, out_stride);
    for (; n < columns; ++n)
      dot_tile<1, 1>(length, a + m * a_stride, a_stride, b + n * b_stride, b_stride,
                     out + m * out_stride + n, out_stride);
  }
}

using Bytes = std::int8_t __attribute__((vector_size(TARSIER_VECTOR_BYTES / 2)));
using Shorts = std::int16_t __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
using Words = std::int32_t __attribute__((vector_size(TARSIER_VECTOR_BYTES)));

inline Shorts widened(const std::int8_t* p) {
  Bytes bytes;
  std::memcpy(&bytes, p, sizeof bytes);
  return __builtin_convertvector(bytes, Shorts);
}

// The sum of two products of at most 127^2 fits into 16 bits.
void byte_dots(int rows, int length, const std::int8_t* a, const std::int8_t* b,
               std::int32_t* out) {
  constexpr int kHalf = TARSIER_VECTOR_BYTES / 2;
  static_assert(kByteStep % (2 * kHalf) == 0);
  for (int n = 0; n < rows; ++n, b += length) {
    Words sum = {};
    for (int i = 0; i < length; i += 2 * kHalf) {
      const Shorts two =
          widened(a + i) * widened(b + i) + widened(a + i + kHalf) * widened(b + i + kHalf);
      Words pairs;
      std::memcpy(&pairs, &two, sizeof pairs);
      sum += (pairs << 16 >> 16) + (pairs >> 16);
    }
    std::int32_t total = 0;
    for (int i = 0; i < TARSIER_VECTOR_BYTES / 4; ++i) total += sum[i];
    out[n] = total;
  }
}

constexpr GemmKernels kKernels{&panel, &panel_at, &dots, &byte_dots};

}  // namespace

const GemmKernels* TARSIER_GEMM() { return &kKernels; }

}  // namespace tarsier::linalg
