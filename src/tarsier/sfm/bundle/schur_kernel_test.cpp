// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/schur_kernel.h"

#include "tarsier/core/cpu.h"
#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace tarsier::sfm {
namespace {

struct Blocks {
  std::vector<double> scaled;
  std::vector<double> mixed;
  std::vector<double> blocks;
};

constexpr int kCount = 7;

Blocks drawn_blocks() {
  Rng rng(3);
  Blocks result{std::vector<double>(18), std::vector<double>(18 * kCount),
                std::vector<double>(36 * kCount)};
  for (std::vector<double>* numbers : {&result.scaled, &result.mixed, &result.blocks})
    std::generate(numbers->begin(), numbers->end(), [&] { return rng.normal(); });
  return result;
}

std::vector<double> after(SubtractProducts subtract, Blocks given) {
  std::vector<PoseBlock> list;
  for (int k = 0; k < kCount; ++k)
    list.push_back({given.mixed.data() + 18 * k, given.blocks.data() + 36 * k});
  subtract(given.scaled.data(), list.data(), kCount);
  return given.blocks;
}

TEST(SubtractProducts, SubtractsProductFromEachBlock) {
  const Blocks given = drawn_blocks();
  const std::vector<double> result = after(subtract_products_baseline(), given);
  for (int k = 0; k < kCount; ++k) {
    for (int r = 0; r < 6; ++r) {
      for (int c = 0; c < 6; ++c) {
        double product = 0;
        for (int j = 0; j < 3; ++j)
          product += given.mixed[static_cast<std::size_t>(18 * k + 6 * j + r)] *
                     given.scaled[static_cast<std::size_t>(6 * j + c)];
        const auto index = static_cast<std::size_t>(36 * k + 6 * c + r);
        EXPECT_NEAR(result[index], given.blocks[index] - product, 1e-14);
      }
    }
  }
}

TEST(SubtractProducts, Avx2EqualsBaseline) {
  if (hardware_simd_level() < SimdLevel::kAvx2) GTEST_SKIP() << "this processor has no AVX2";
  EXPECT_EQ(after(subtract_products_avx2(), drawn_blocks()),
            after(subtract_products_baseline(), drawn_blocks()));
}

}  // namespace
}  // namespace tarsier::sfm
