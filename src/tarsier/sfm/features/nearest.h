// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// The two nearest neighbours of every row of bytes, in both directions, by integer arithmetic only:
// |a - b|^2 = |a|^2 + |b|^2 - 2 a.b. Compiled for each instruction set from one source
// (nearest.inl) and chosen at run time. All kernels give the same results.
namespace tarsier::sfm {

// `count` consecutive rows of `depth` bytes each; depth 1..4096.
struct ByteRows {
  const std::uint8_t* data = nullptr;
  int count = 0;
  int depth = 0;
  // Null: each row is a group of its own. Otherwise one number per row: of rows with the same
  // number only the nearest counts. Nearest::second is then the nearest row with another number
  // than Nearest::index.
  const std::int32_t* groups = nullptr;
};

// Larger than any squared distance: no neighbour.
inline constexpr std::int32_t kNoNeighbour = 1 << 28;

struct Nearest {
  std::int32_t best = kNoNeighbour;
  std::int32_t second = kNoNeighbour;
  int index = -1;  // index of the nearest row; the first of equally near ones
};

// Fills of_first[0..first.count) and of_second[0..second.count). Throws std::invalid_argument
// unless the depths are equal and in range.
void find_nearest(const ByteRows& first, const ByteRows& second, Nearest* of_first,
                  Nearest* of_second);

// The loops of find_nearest(). They allocate nothing, because standard library code that is shared
// with other units must not be compiled for a special instruction set.
struct NearestKernel {
  std::size_t (*scratch_bytes)(int first_count, int depth);
  // `scratch`: scratch_bytes() bytes, aligned to 64.
  void (*run)(const ByteRows& first, const ByteRows& second, void* scratch, Nearest* of_first,
              Nearest* of_second);
};
[[nodiscard]] const NearestKernel& nearest_kernel();

// Null where the compiler's target or this processor lacks the instructions.
[[nodiscard]] const NearestKernel* nearest_baseline();
[[nodiscard]] const NearestKernel* nearest_avx2();
[[nodiscard]] const NearestKernel* nearest_vnni();  // AVX-512 with VNNI
// NEON with dot products. Call it only where simd_level() is SimdLevel::kDotProducts.
[[nodiscard]] const NearestKernel* nearest_dotprod();

}  // namespace tarsier::sfm
