// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

// The inside of tile_cholesky.h: products of tiles, compiled for each instruction set.
namespace tarsier::linalg {

constexpr int kTileSize = 48;  // rows and columns: eight cameras
constexpr int kStrip = 8;      // rows
constexpr std::size_t kTileNumbers = std::size_t{kTileSize} * kTileSize;

// A tile lies in memory as strips of 8 rows, one after the other, each of them column by column.
constexpr std::size_t in_tile(int row, int column) {
  return static_cast<std::size_t>((row / kStrip * kTileSize + column) * kStrip + row % kStrip);
}

// All sets of kernels give the same numbers, to the last bit.
struct TileKernels {
  // c -= a b^T
  void (*subtract_product)(const double* a, const double* b, double* c);
  // a = a L^-T; L is the lower triangle of `l`
  void (*divide)(const double* l, double* a);
};

// The fastest ones of this processor.
[[nodiscard]] const TileKernels& tile_kernels();

// Of single instruction sets; null where they were not compiled.
[[nodiscard]] const TileKernels* tile_kernels_baseline();
[[nodiscard]] const TileKernels* tile_kernels_avx2();
[[nodiscard]] const TileKernels* tile_kernels_avx512();

}  // namespace tarsier::linalg
