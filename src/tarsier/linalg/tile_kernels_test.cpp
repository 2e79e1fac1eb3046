// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tile_kernels.h"

#include "tarsier/core/cpu.h"
#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

namespace tarsier::linalg {
namespace {

std::vector<double> random_tile(std::uint64_t seed) {
  Rng rng(seed);
  std::vector<double> tile(kTileElements);
  std::generate(tile.begin(), tile.end(), [&] { return rng.normal(); });
  return tile;
}

// A lower triangle with a small inverse.
std::vector<double> triangle() {
  std::vector<double> tile = random_tile(4);
  for (int k = 0; k < kTileSize; ++k) tile[in_tile(k, k)] = 12 + k;
  return tile;
}

std::vector<double> subtract_and_solve(const TileKernels& kernels) {
  std::vector<double> tile = random_tile(1);
  kernels.subtract_product(random_tile(2).data(), random_tile(3).data(), tile.data());
  kernels.solve_triangular(triangle().data(), tile.data());
  return tile;
}

TEST(TileKernels, SubtractsAProduct) {
  const std::vector<double> a = random_tile(2);
  const std::vector<double> b = random_tile(3);
  const std::vector<double> before = random_tile(1);
  std::vector<double> c = before;
  tile_kernels_baseline()->subtract_product(a.data(), b.data(), c.data());
  for (int row = 0; row < kTileSize; ++row) {
    for (int column = 0; column < kTileSize; ++column) {
      double sum = 0;
      for (int k = 0; k < kTileSize; ++k) sum += a[in_tile(row, k)] * b[in_tile(column, k)];
      EXPECT_NEAR(c[in_tile(row, column)], before[in_tile(row, column)] - sum, 1e-12);
    }
  }
}

TEST(TileKernels, SolvesATriangularSystem) {
  const std::vector<double> l = triangle();
  const std::vector<double> before = random_tile(1);
  std::vector<double> a = before;
  tile_kernels_baseline()->solve_triangular(l.data(), a.data());
  for (int row = 0; row < kTileSize; ++row) {
    for (int column = 0; column < kTileSize; ++column) {
      double sum = 0;
      for (int k = 0; k <= column; ++k) sum += a[in_tile(row, k)] * l[in_tile(column, k)];
      EXPECT_NEAR(sum, before[in_tile(row, column)], 1e-12);
    }
  }
}

TEST(TileKernels, AllInstructionSetsAgree) {
  if (hardware_simd_level() < SimdLevel::kAvx2) GTEST_SKIP() << "this processor has no AVX2";
  const std::vector<double> baseline = subtract_and_solve(*tile_kernels_baseline());
  EXPECT_EQ(subtract_and_solve(*tile_kernels_avx2()), baseline);
  if (hardware_simd_level() >= SimdLevel::kAvx512) {
    EXPECT_EQ(subtract_and_solve(*tile_kernels_avx512()), baseline);
  }
}

}  // namespace
}  // namespace tarsier::linalg
