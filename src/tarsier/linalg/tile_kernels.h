// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

// Internals of tile_cholesky.h: products of tiles, compiled for each instruction set.
namespace tarsier::linalg {

constexpr int kTileSize = 24;  // rows and columns: four cameras
constexpr int kStrip = 8;      // rows
constexpr std::size_t kTileElements = std::size_t{kTileSize} * kTileSize;

// In memory, a tile is a sequence of strips of 8 rows; each strip is column-major.
constexpr std::size_t in_tile(int row, int column) {
  const int element = (row / kStrip * kTileSize + column) * kStrip + row % kStrip;
  return static_cast<std::size_t>(element);
}

// All kernel sets give bit-identical results.
struct TileKernels {
  // c -= a b^T
  void (*subtract_product)(const double* a, const double* b, double* c);
  // a = a L^-T; L is the lower triangle of `l`
  void (*solve_triangular)(const double* l, double* a);
};

// The fastest kernels of this processor.
[[nodiscard]] const TileKernels& tile_kernels();

// The kernels of one instruction set; null if they were not compiled.
[[nodiscard]] const TileKernels* tile_kernels_baseline();
[[nodiscard]] const TileKernels* tile_kernels_avx2();
[[nodiscard]] const TileKernels* tile_kernels_avx512();

}  // namespace tarsier::linalg
