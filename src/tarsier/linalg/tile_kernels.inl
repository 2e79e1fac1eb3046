// SPDX-License-Identifier: MIT
// Included once for each instruction set. The including file defines TARSIER_VECTOR_BYTES (16, 32,
// 64), TARSIER_STRIPS and TARSIER_COLUMNS (the part of a product that stays in registers), and
// TARSIER_TILE_KERNELS (the function's name). Multiplications and additions are not fused, and each
// sum adds its terms in order. So all instruction sets round in the same way.
#include "tarsier/linalg/tile_kernels.h"

#include <cstring>

namespace tarsier::linalg {
namespace {

using Vector = double __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
constexpr int kLanes = TARSIER_VECTOR_BYTES / 8;
constexpr int kVectorsPerStrip = kStrip / kLanes;  // vectors in a strip
constexpr int kVectors = TARSIER_STRIPS * kVectorsPerStrip;
constexpr int kColumns = TARSIER_COLUMNS;
constexpr std::ptrdiff_t kStripElements = std::ptrdiff_t{kStrip} * kTileSize;
static_assert(kStrip % kColumns == 0 && kTileSize % (TARSIER_STRIPS * kStrip) == 0);

inline Vector load(const double* p) {
  Vector v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline void store(double* p, Vector v) { std::memcpy(p, &v, sizeof v); }

// Offset of vector v of a column from the column's first strip.
constexpr std::ptrdiff_t vector_offset(int v) {
  return v / kVectorsPerStrip * kStripElements + std::ptrdiff_t{v % kVectorsPerStrip} * kLanes;
}

// `b` points to its first row that corresponds to a column of `c`.
inline void subtract_block(const double* a, const double* b, double* c) {
  Vector sum[kVectors][kColumns];
  for (int n = 0; n < kColumns; ++n)
    for (int v = 0; v < kVectors; ++v)
      sum[v][n] = load(c + vector_offset(v) + std::ptrdiff_t{n} * kStrip);
  for (int k = 0; k < kTileSize; ++k) {
    Vector rows[kVectors];
    for (int v = 0; v < kVectors; ++v)
      rows[v] = load(a + vector_offset(v) + std::ptrdiff_t{k} * kStrip);
    for (int n = 0; n < kColumns; ++n) {
      const double factor = b[k * kStrip + n];
      for (int v = 0; v < kVectors; ++v) sum[v][n] -= rows[v] * factor;
    }
  }
  for (int n = 0; n < kColumns; ++n)
    for (int v = 0; v < kVectors; ++v)
      store(c + vector_offset(v) + std::ptrdiff_t{n} * kStrip, sum[v][n]);
}

void subtract_product(const double* a, const double* b, double* c) {
  for (int column = 0; column < kTileSize; column += kColumns)
    for (int row = 0; row < kTileSize; row += TARSIER_STRIPS * kStrip)
      subtract_block(a + in_tile(row, 0), b + in_tile(column, 0), c + in_tile(row, column));
}

void solve_triangular(const double* l, double* a) {
  for (int row = 0; row < kTileSize; row += TARSIER_STRIPS * kStrip) {
    double* strips = a + in_tile(row, 0);
    for (int column = 0; column < kTileSize; ++column) {
      double* own = strips + std::ptrdiff_t{column} * kStrip;
      Vector sum[kVectors];
      for (int v = 0; v < kVectors; ++v) sum[v] = load(own + vector_offset(v));
      for (int k = 0; k < column; ++k) {
        const double factor = l[in_tile(column, k)];
        for (int v = 0; v < kVectors; ++v)
          sum[v] -= load(strips + vector_offset(v) + std::ptrdiff_t{k} * kStrip) * factor;
      }
      const double diagonal = l[in_tile(column, column)];
      for (int v = 0; v < kVectors; ++v) store(own + vector_offset(v), sum[v] / diagonal);
    }
  }
}

const TileKernels kernels{subtract_product, solve_triangular};

}  // namespace

const TileKernels* TARSIER_TILE_KERNELS() { return &kernels; }

}  // namespace tarsier::linalg
