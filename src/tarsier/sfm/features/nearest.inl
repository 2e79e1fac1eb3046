// SPDX-License-Identifier: MIT
// Included once for each instruction set. The including file defines TARSIER_VECTOR_BYTES (16, 32,
// 64), TARSIER_TILE_ROWS (rows of a register tile) and TARSIER_NEAREST (the function's name). It
// also defines TARSIER_BYTE_DOTS (1: one instruction adds four products of bytes to a lane,
// vpdpbusd or udot; 0: two products, of bytes on arm64, else of 16 bits).
#include "tarsier/sfm/features/nearest.h"

#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

namespace tarsier::sfm {
namespace {

using Vector = std::int32_t __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
constexpr int kLanes = TARSIER_VECTOR_BYTES / 4;
constexpr int kVectors = 3;
constexpr int kColumns = kVectors * kLanes;  // columns of a panel of the second rows
constexpr int kRows = TARSIER_TILE_ROWS;
// kGroup: number of products that one lane adds at a time.
// RowGroup, ColumnGroups: the groups of one row, and of the columns of a vector.
#if TARSIER_BYTE_DOTS && defined(__aarch64__)
using Number = std::uint8_t;
constexpr int kGroup = 4;
constexpr int kOffset = 0;
using RowGroup = std::uint32_t;
using ColumnGroups = uint8x16_t;
#elif TARSIER_BYTE_DOTS
using Number = std::uint8_t;
constexpr int kGroup = 4;
constexpr int kOffset = 128;  // vpdpbusd needs a signed second factor
using RowGroup = std::int32_t;
using ColumnGroups = Vector;
#elif defined(__aarch64__)
using Number = std::uint8_t;
constexpr int kGroup = 2;
constexpr int kOffset = 0;
using RowGroup = std::uint16_t;
using ColumnGroups = uint8x8_t;
#else
using Number = std::int16_t;
constexpr int kGroup = 2;
constexpr int kOffset = 0;
using RowGroup = std::int32_t;
using ColumnGroups = Vector;
#endif
constexpr std::int32_t kPadding = 1 << 29;  // squared length of padding rows

template <class T>
inline T load_as(const void* p) {
  T value;
  std::memcpy(&value, p, sizeof value);
  return value;
}
inline Vector load(const void* p) { return load_as<Vector>(p); }

// Adds the products of one row's group (the same in all lanes) and the columns' groups to `sum`.
inline Vector add_products(Vector sum, RowGroup row, ColumnGroups columns) {
#if TARSIER_BYTE_DOTS && defined(__aarch64__)
  return reinterpret_cast<Vector>(vdotq_u32(reinterpret_cast<uint32x4_t>(sum),
                                            vreinterpretq_u8_u32(vdupq_n_u32(row)), columns));
#elif TARSIER_BYTE_DOTS
  return reinterpret_cast<Vector>(_mm512_dpbusd_epi32(
      reinterpret_cast<__m512i>(sum), _mm512_set1_epi32(row), reinterpret_cast<__m512i>(columns)));
#elif defined(__AVX2__)
  return sum + reinterpret_cast<Vector>(
                   _mm256_madd_epi16(_mm256_set1_epi32(row), reinterpret_cast<__m256i>(columns)));
#elif defined(__SSE2__)
  return sum + reinterpret_cast<Vector>(
                   _mm_madd_epi16(_mm_set1_epi32(row), reinterpret_cast<__m128i>(columns)));
#elif defined(__aarch64__)
  return reinterpret_cast<Vector>(vpadalq_u16(
      reinterpret_cast<uint32x4_t>(sum), vmull_u8(vreinterpret_u8_u16(vdup_n_u16(row)), columns)));
#else
  std::int16_t a[2];
  std::memcpy(a, &row, sizeof a);
  return sum + a[0] * ((columns << 16) >> 16) + a[1] * (columns >> 16);
#endif
}

// Bit k is set if lane k of `value` is less than lane k of `bound`.
inline unsigned less(Vector value, Vector bound) {
#if TARSIER_VECTOR_BYTES == 64
  return _mm512_cmplt_epi32_mask(reinterpret_cast<__m512i>(value),
                                 reinterpret_cast<__m512i>(bound));
#elif defined(__AVX2__)
  return static_cast<unsigned>(
      _mm256_movemask_ps(reinterpret_cast<__m256>(static_cast<Vector>(value < bound))));
#elif defined(__SSE2__)
  return static_cast<unsigned>(
      _mm_movemask_ps(reinterpret_cast<__m128>(static_cast<Vector>(value < bound))));
#elif defined(__aarch64__)
  constexpr uint32x4_t kBits = {1, 2, 4, 8};
  return vaddvq_u32(vandq_u32(vcltq_s32(value, bound), kBits));
#else
  unsigned mask = 0;
  for (int k = 0; k < kLanes; ++k) mask |= static_cast<unsigned>(value[k] < bound[k]) << k;
  return mask;
#endif
}

inline Vector larger(Vector a, Vector b) { return a > b ? a : b; }

std::int32_t square_of(const std::uint8_t* row, int depth) {
  std::int32_t sum = 0;
  for (int k = 0; k < depth; ++k) sum += row[k] * row[k];
  return sum;
}

constexpr int padded(int count) { return (count + kRows - 1) / kRows * kRows; }
constexpr int groups_of(int depth) { return (depth + kGroup - 1) / kGroup; }
constexpr std::size_t aligned(std::size_t bytes) { return (bytes + 63) / 64 * 64; }

// Layout of the scratch memory.
struct Buffers {
  Number* first_rows;     // the first rows, padded to whole tiles and groups
  std::int32_t* squares;  // their squared lengths, corrected for kOffset
  std::int32_t* seconds;  // their Nearest::second
  Number* panel;          // the numbers of kColumns second rows, group by group

  static std::size_t lay_out(void* scratch, int count, int depth, Buffers& buffers) {
    char* const base = static_cast<char*>(scratch);
    const auto rows = static_cast<std::size_t>(padded(count));
    const std::size_t numbers =
        static_cast<std::size_t>(groups_of(depth)) * kGroup * sizeof(Number);
    std::size_t at = 0;
    buffers.first_rows = reinterpret_cast<Number*>(base + at);
    at += aligned(rows * numbers);
    buffers.squares = reinterpret_cast<std::int32_t*>(base + at);
    at += aligned(rows * sizeof(std::int32_t));
    buffers.seconds = reinterpret_cast<std::int32_t*>(base + at);
    at += aligned(rows * sizeof(std::int32_t));
    buffers.panel = reinterpret_cast<Number*>(base + at);
    return at + aligned(numbers * kColumns);
  }
};

std::size_t scratch_bytes(int first_count, int depth) {
  alignas(64) char none[64];
  Buffers buffers{};
  return Buffers::lay_out(none, first_count, depth, buffers);
}

void pack_first_rows(const ByteRows& rows, const Buffers& buffers) {
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(groups_of(rows.depth)) * kGroup;
  for (int r = 0; r < padded(rows.count); ++r) {
    Number* const out = buffers.first_rows + r * stride;
    std::memset(out, 0, static_cast<std::size_t>(stride) * sizeof(Number));
    buffers.seconds[r] = kNoNeighbour;
    buffers.squares[r] = kPadding;
    if (r >= rows.count) continue;
    const std::uint8_t* const in = rows.data + static_cast<std::ptrdiff_t>(r) * rows.depth;
    std::int32_t sum = 0;
    for (int k = 0; k < rows.depth; ++k) {
      out[k] = in[k];
      sum += in[k];
    }
    buffers.squares[r] = square_of(in, rows.depth) - 2 * kOffset * sum;
  }
}

// Writes a panel, and the squared lengths of its columns to `squares`.
void pack_panel(const ByteRows& rows, int from, Number* out, std::int32_t* squares) {
  const int depth = groups_of(rows.depth) * kGroup;
  for (int c = 0; c < kColumns; ++c) {
    const bool there = from + c < rows.count;
    const std::uint8_t* const in =
        rows.data + (there ? static_cast<std::ptrdiff_t>(from + c) * rows.depth : 0);
    squares[c] = there ? square_of(in, rows.depth) : kPadding;
    for (int k = 0; k < depth; ++k) {
      const int number = there && k < rows.depth ? in[k] : 0;
      out[(k / kGroup * kColumns + c) * kGroup + k % kGroup] =
          static_cast<Number>(number - kOffset);
    }
  }
}

// `groups`: the candidates' groups, as in ByteRows.
void update_nearest(Nearest& nearest, std::int32_t distance, int candidate,
                    const std::int32_t* groups) {
  const bool same =
      groups != nullptr && nearest.index >= 0 && groups[nearest.index] == groups[candidate];
  if (distance < nearest.best) {
    if (!same) nearest.second = nearest.best;
    nearest.best = distance;
    nearest.index = candidate;
  } else if (distance < nearest.second && !same) {
    nearest.second = distance;
  }
}

// sum[r][v] = products of kRows rows with the columns of a panel.
inline void tile(int groups, const Number* a, const Number* b, Vector (&sum)[kRows][kVectors]) {
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(groups) * kGroup;
  Vector result[kRows][kVectors] = {};
  for (int g = 0; g < groups; ++g) {
    ColumnGroups columns[kVectors];
    for (int v = 0; v < kVectors; ++v) columns[v] = load_as<ColumnGroups>(b + v * kLanes * kGroup);
    for (int r = 0; r < kRows; ++r) {
      const auto row = load_as<RowGroup>(a + r * stride);
      for (int v = 0; v < kVectors; ++v) result[r][v] = add_products(result[r][v], row, columns[v]);
    }
    a += kGroup;
    b += kColumns * kGroup;
  }
  std::memcpy(sum, result, sizeof result);
}

void run(const ByteRows& first, const ByteRows& second, void* scratch, Nearest* of_first,
         Nearest* of_second) {
  Buffers buffers{};
  Buffers::lay_out(scratch, first.count, first.depth, buffers);
  pack_first_rows(first, buffers);
  for (int i = 0; i < first.count; ++i) of_first[i] = Nearest{};
  for (int i = 0; i < second.count; ++i) of_second[i] = Nearest{};
  const int groups = groups_of(first.depth);
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(groups) * kGroup;
  alignas(TARSIER_VECTOR_BYTES) std::int32_t squares[kColumns];
  alignas(TARSIER_VECTOR_BYTES) std::int32_t seconds[kColumns];  // Nearest::second of the columns
  for (int from = 0; from < second.count; from += kColumns) {
    pack_panel(second, from, buffers.panel, squares);
    for (std::int32_t& value : seconds) value = kNoNeighbour;
    for (int start = 0; start < first.count; start += kRows) {
      Vector sum[kRows][kVectors];
      tile(groups, buffers.first_rows + start * stride, buffers.panel, sum);
      for (int r = 0; r < kRows; ++r) {
        const int row = start + r;
        for (int v = 0; v < kVectors; ++v) {
          const Vector distance = buffers.squares[row] + load(squares + v * kLanes) - 2 * sum[r][v];
          const Vector bound = larger(load(seconds + v * kLanes), Vector{} + buffers.seconds[row]);
          // Few candidates are nearer than the second nearest so far of their row or column.
          for (unsigned mask = less(distance, bound); mask != 0; mask &= mask - 1) {
            const int lane = __builtin_ctz(mask);
            const int column = v * kLanes + lane;
            std::int32_t values[kLanes];
            std::memcpy(values, &distance, sizeof values);
            update_nearest(of_first[row], values[lane], from + column, second.groups);
            buffers.seconds[row] = of_first[row].second;
            update_nearest(of_second[from + column], values[lane], row, first.groups);
            seconds[column] = of_second[from + column].second;
          }
        }
      }
    }
  }
}

constexpr NearestKernel kKernel{scratch_bytes, run};

}  // namespace
}  // namespace tarsier::sfm

const tarsier::sfm::NearestKernel* tarsier::sfm::TARSIER_NEAREST() { return &kKernel; }
