// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/nearest.h"

#include "tarsier/core/cpu.h"
#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <new>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

std::vector<std::uint8_t> random_bytes(int count, int most, std::uint64_t seed) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(count));
  Rng rng(seed);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(rng.integer(0, most));
  return bytes;
}

std::vector<Nearest> by_definition(const ByteRows& rows, const ByteRows& others) {
  std::vector<Nearest> result;
  for (int i = 0; i < rows.count; ++i) {
    Nearest nearest;
    for (int j = 0; j < others.count; ++j) {
      std::int32_t distance = 0;
      for (int k = 0; k < rows.depth; ++k) {
        const int d = rows.data[i * rows.depth + k] - others.data[j * rows.depth + k];
        distance += d * d;
      }
      if (distance < nearest.best) {
        nearest.best = distance;
        nearest.index = j;
      }
    }
    // The second nearest, among the others.
    for (int j = 0; j < others.count; ++j) {
      if (j == nearest.index ||
          (others.groups != nullptr && others.groups[j] == others.groups[nearest.index]))
        continue;
      std::int32_t distance = 0;
      for (int k = 0; k < rows.depth; ++k) {
        const int d = rows.data[i * rows.depth + k] - others.data[j * rows.depth + k];
        distance += d * d;
      }
      nearest.second = std::min(nearest.second, distance);
    }
    result.push_back(nearest);
  }
  return result;
}

std::vector<std::pair<const char*, const NearestKernel*>> kernels() {
  std::vector<std::pair<const char*, const NearestKernel*>> result{
      {"baseline", nearest_baseline()}};
  const SimdLevel level = hardware_simd_level();
  if (level == SimdLevel::kDotProducts) result.emplace_back("dotprod", nearest_dotprod());
  if (level >= SimdLevel::kAvx2) result.emplace_back("avx2", nearest_avx2());
  if (level >= SimdLevel::kAvx512 && nearest_vnni() != nullptr)
    result.emplace_back("vnni", nearest_vnni());
  return result;
}

void expect_same(const std::vector<Nearest>& a, const std::vector<Nearest>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].best, b[i].best) << i;
    EXPECT_EQ(a[i].second, b[i].second) << i;
    EXPECT_EQ(a[i].index, b[i].index) << i;
  }
}

// Row counts around those of a tile and a panel, depths around that of a group. Bytes up to 255,
// whose products need 16 bits.
TEST(FindNearest, EachInstructionSetEqualsReferenceImplementation) {
  for (const auto& [name, kernel] : kernels()) {
    for (const int most : {1, 255}) {
      for (const auto& [rows, others, depth] :
           {std::array{1, 1, 1}, std::array{7, 50, 128}, std::array{33, 97, 61},
            std::array{64, 48, 488}, std::array{9, 5, 3}}) {
        SCOPED_TRACE(testing::Message() << name << ' ' << rows << 'x' << others << 'x' << depth);
        const auto a = random_bytes(rows * depth, most, 1);
        const auto b = random_bytes(others * depth, most, 2);
        const ByteRows first{a.data(), rows, depth};
        const ByteRows second{b.data(), others, depth};
        std::vector<Nearest> of_a(static_cast<std::size_t>(rows));
        std::vector<Nearest> of_b(static_cast<std::size_t>(others));
        const std::align_val_t alignment{64};
        void* scratch = ::operator new(kernel->scratch_bytes(rows, depth), alignment);
        kernel->run(first, second, scratch, of_a.data(), of_b.data());
        ::operator delete(scratch, alignment);
        expect_same(of_a, by_definition(first, second));
        expect_same(of_b, by_definition(second, first));
      }
    }
  }
}

TEST(FindNearest, SecondNearestIsOfAnotherGroup) {
  constexpr int kRows = 90;
  constexpr int kOthers = 150;
  constexpr int kDepth = 16;
  const auto a = random_bytes(kRows * kDepth, 40, 3);
  const auto b = random_bytes(kOthers * kDepth, 40, 4);
  Rng rng(5);
  std::vector<std::int32_t> groups_a(kRows);
  std::vector<std::int32_t> groups_b(kOthers);
  for (auto& group : groups_a) group = rng.integer(0, 12);
  for (auto& group : groups_b) group = rng.integer(0, 20);
  const ByteRows first{a.data(), kRows, kDepth, groups_a.data()};
  const ByteRows second{b.data(), kOthers, kDepth, groups_b.data()};
  for (const auto& [name, kernel] : kernels()) {
    SCOPED_TRACE(name);
    std::vector<Nearest> of_a(kRows);
    std::vector<Nearest> of_b(kOthers);
    const std::align_val_t alignment{64};
    void* scratch = ::operator new(kernel->scratch_bytes(kRows, kDepth), alignment);
    kernel->run(first, second, scratch, of_a.data(), of_b.data());
    ::operator delete(scratch, alignment);
    expect_same(of_a, by_definition(first, second));
    expect_same(of_b, by_definition(second, first));
  }
}

TEST(FindNearest, FindsNothingAmongNoRows) {
  const auto a = random_bytes(3 * 128, 255, 1);
  std::vector<Nearest> of_a(3);
  find_nearest({a.data(), 3, 128}, {nullptr, 0, 128}, of_a.data(), nullptr);
  for (const Nearest& nearest : of_a) {
    EXPECT_EQ(nearest.index, -1);
    EXPECT_EQ(nearest.best, kNoNeighbour);
  }
}

TEST(FindNearest, RefusesRowsOfDifferentDepth) {
  const auto a = random_bytes(128, 255, 1);
  Nearest nearest;
  EXPECT_THROW(find_nearest({a.data(), 1, 128}, {a.data(), 1, 64}, &nearest, &nearest),
               std::invalid_argument);
  EXPECT_THROW(find_nearest({a.data(), 0, 0}, {a.data(), 0, 0}, &nearest, &nearest),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
