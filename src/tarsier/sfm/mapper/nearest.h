// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// The two nearest neighbours of every row of bytes, in both directions, by integer arithmetic alone:
// |a - b|^2 = |a|^2 + |b|^2 - 2 a.b. Compiled once for each instruction set from one source
// (nearest.inl) and chosen at run time; all of them give the same numbers.
namespace tarsier::sfm {

// `count` rows of `depth` bytes each, one after the other; depth 1..4096.
struct ByteRows {
  const std::uint8_t* data = nullptr;
  int count = 0;
  int depth = 0;
  // Null: each row is by itself. Else one number a row: of rows with the same number only the nearest one counts, so that
  // Nearest::second is that of the nearest row with another number than Nearest::index has.
  const std::int32_t* groups = nullptr;
};

// Squared distances. More than any: none was seen.
inline constexpr std::int32_t kNoNeighbour = 1 << 28;

struct Nearest {
  std::int32_t best = kNoNeighbour;
  std::int32_t second = kNoNeighbour;
  int index = -1;  // of the nearest; of equal ones the first
};

// Fills of_first[0..first.count) and of_second[0..second.count). Throws std::invalid_argument unless
// the depths are the same and in their range.
void find_nearest(const ByteRows& first, const ByteRows& second, Nearest* of_first,
                  Nearest* of_second);

// The loops of find_nearest(). They allocate nothing: no code of the standard library that others
// use may be compiled for an instruction set of its own.
struct NearestKernel {
  std::size_t (*scratch_bytes)(int first_count, int depth);
  // `scratch`: so many bytes, aligned to 64.
  void (*run)(const ByteRows& first, const ByteRows& second, void* scratch, Nearest* of_first,
              Nearest* of_second);
};
[[nodiscard]] const NearestKernel& nearest_kernel();

// Null where the compiler's target or this processor has no such instructions.
[[nodiscard]] const NearestKernel* nearest_baseline();
[[nodiscard]] const NearestKernel* nearest_avx2();
[[nodiscard]] const NearestKernel* nearest_vnni();  // AVX-512 with VNNI

}  // namespace tarsier::sfm
