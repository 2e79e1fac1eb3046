// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/kernels.h"
#include "tarsier/cartoon/simd_x86.h"

// The bilateral filter of diameter 9 for processors with AVX-512 VNNI. Only kernels_avx512.cpp
// includes it. Its output is identical to that of bilateral_row in kernels.inl.
//
// vpdpbusd adds four products of bytes to a 32-bit sum. Four neighbours of one pixel therefore lie
// together in 32 bits, a quad. A register holds the quads of the 16 pixels x + phase, x + phase + 4
// .. for a phase 0..3. The 48 neighbours form 12 quads of three kinds:
//
//   dy -4:         X               X  singles, collected for each row
//    dy -3:     L L L L X           L  level: four in a row, as they lie in the plane
//    dy -2:   V V V V V V V         V  vertical: dy -2, -1, 1, 2 of one column, collected once
//    dy -1:   V V V V V V V            for each row and used with seven dx
//    dy  0: L L L L . L L L L
//
// and symmetrically below. The products use the neighbour itself, not its difference from the
// centre as in kernels.inl: sum w (c - v) = c sum w - sum w v, which is exact in 32 bits.
//
// On Zen 4, fewer units execute saturating arithmetic, |x| and products than sums, minima and
// maxima. For two of the three planes |c - v| is therefore computed as max - min, which balances
// the units.
#define TARSIER_VNNI __attribute__((target("avx512f,avx512bw,avx512vl,avx512vbmi,avx512vnni")))
#define TARSIER_VNNI_INLINE TARSIER_VNNI TARSIER_INLINE
#define TARSIER_VNNI_INLINE_LAMBDA \
  __attribute__((always_inline, target("avx512f,avx512bw,avx512vl,avx512vbmi,avx512vnni")))

namespace {

using tarsier::cartoon::BilateralTaps;

constexpr int kQuadStrip = 512;  // pixels whose vertical quads are made in one step
// Bytes of one phase of one plane: the strip, 64 pixels before it and 128 after it.
constexpr int kQuadRow = 64 + kQuadStrip + 128;
constexpr int kFirstQuad = 64;

struct QuadIndices {
  alignas(64) std::uint8_t bytes[2][64];  // interleaves two rows: two phases of pairs
  // Interleaves two registers of pairs: one phase of quads.
  alignas(64) std::uint16_t words[2][32];
  // For each phase: repeats one byte of four, four times.
  alignas(64) std::uint8_t four_times[4][64];
};
constexpr QuadIndices quad_indices() {
  QuadIndices result{};
  for (int half = 0; half < 2; ++half) {
    for (int i = 0; i < 32; ++i) {
      const int pixel = 4 * (i % 16) + 2 * half + i / 16;
      result.bytes[half][2 * i] = static_cast<std::uint8_t>(pixel);
      result.bytes[half][2 * i + 1] = static_cast<std::uint8_t>(64 + pixel);
      result.words[half][i] = static_cast<std::uint16_t>(16 * half + i / 2 + 32 * (i % 2));
    }
  }
  for (int phase = 0; phase < 4; ++phase) {
    for (int i = 0; i < 64; ++i) {
      result.four_times[phase][i] = static_cast<std::uint8_t>((i % 16) / 4 * 4 + phase);
    }
  }
  return result;
}
constexpr QuadIndices kQuadIndices = quad_indices();

// Stores the quads of the bytes at four addresses for 64 pixels; `phase_size` is the distance of
// the phases in bytes. All loads precede the stores because GCC cannot exclude aliasing.
TARSIER_VNNI_INLINE void store_quads(const std::uint8_t* a, const std::uint8_t* b,
                                     const std::uint8_t* c, const std::uint8_t* d, std::uint8_t* to,
                                     int phase_size) {
  const Reg rows[4] = {reg_load(a), reg_load(b), reg_load(c), reg_load(d)};
  Reg quads[4];
#pragma GCC unroll 2
  for (int half = 0; half < 2; ++half) {
    const Reg bytes = reg_load(kQuadIndices.bytes[half]);
    const Reg ab = _mm512_permutex2var_epi8(rows[0], bytes, rows[1]);
    const Reg cd = _mm512_permutex2var_epi8(rows[2], bytes, rows[3]);
    quads[2 * half] = _mm512_permutex2var_epi16(ab, reg_load(kQuadIndices.words[0]), cd);
    quads[2 * half + 1] = _mm512_permutex2var_epi16(ab, reg_load(kQuadIndices.words[1]), cd);
  }
#pragma GCC unroll 4
  for (int phase = 0; phase < 4; ++phase) reg_store(to + phase * phase_size, quads[phase]);
}

struct QuadSums {
  Reg weight, b, g, r;
};

TARSIER_VNNI_INLINE Reg distance(Reg a, Reg b) {
  return _mm512_sub_epi8(_mm512_max_epi8(a, b), _mm512_min_epi8(a, b));
}

// Weights of four neighbours, kBilateralTable for each. If `high` is null, the two outer neighbours
// share one table, and so do the two inner ones.
TARSIER_VNNI_INLINE Reg weights_of(Reg far, Reg low, const Reg* high) {
  const Reg near = _mm512_min_epu8(far, _mm512_set1_epi8(31));
  return high == nullptr
             ? _mm512_permutexvar_epi8(near | _mm512_set1_epi32(0x00202000), low)
             : _mm512_permutex2var_epi8(low, near | _mm512_set1_epi32(0x60402000), *high);
}

// Computes the correction of the pixels of phases 2 kPart and 2 kPart + 1. Each correction is in
// its own byte of the 32 bits of `less`, one register per plane; it is subtracted from the pixel.
// `vertical`: quads of the strip at this x; `single`: quads of these 64 pixels. other_work(0..5) is
// called in between.
template <int kPart, typename Work>
TARSIER_VNNI_INLINE void filter_phases(const BilateralTaps& taps, const std::uint8_t* const* at,
                                       const std::uint8_t* vertical, const std::uint8_t* single,
                                       const Work& other_work, Reg* less) {
  Reg c[2][3];
  QuadSums sums[2];
#pragma GCC unroll 2
  for (int k = 0; k < 2; ++k) {
    const Reg phase = reg_load(kQuadIndices.four_times[2 * kPart + k]);
    for (int i = 0; i < 3; ++i) c[k][i] = _mm512_shuffle_epi8(reg_load(at[i]), phase);
    const Reg zero = _mm512_setzero_si512();
    sums[k] = {zero, zero, zero, zero};
  }
  // Adds the products of the neighbours v of the pixels of one phase. Weights are first added in
  // pairs; such a sum is at most 254 and fits into a byte.
  Reg before[2];
  int count[2] = {0, 0};
  const auto add_quad = [&](int k, const Reg* v, Reg low,
                            const Reg* high) TARSIER_VNNI_INLINE_LAMBDA {
    const Reg far =
        _mm512_adds_epu8(_mm512_adds_epu8(distance(c[k][0], v[0]), distance(c[k][1], v[1])),
                         _mm512_abs_epi8(_mm512_subs_epi8(c[k][2], v[2])));
    const Reg w = weights_of(far, low, high);
    sums[k].b = _mm512_dpbusd_epi32(sums[k].b, w, v[0]);
    sums[k].g = _mm512_dpbusd_epi32(sums[k].g, w, v[1]);
    sums[k].r = _mm512_dpbusd_epi32(sums[k].r, w, v[2]);
    if (count[k]++ % 2 == 0) {
      before[k] = w;
    } else {
      sums[k].weight =
          _mm512_dpbusd_epi32(sums[k].weight, _mm512_add_epi8(before[k], w), _mm512_set1_epi8(1));
    }
  };
  // Kept in registers: otherwise GCC loads them again for each use, and loads across two cache
  // lines are slow.
  const auto keep = [](Reg* v) TARSIER_VNNI_INLINE_LAMBDA {
    asm("" : "+v"(v[0]), "+v"(v[1]), "+v"(v[2]));
  };
  const std::ptrdiff_t level[4] = {-4, 1, -3 * taps.stride - 2, 3 * taps.stride - 2};
#pragma GCC unroll 5
  for (int quad = 0; quad < 5; ++quad) {
    const std::uint8_t* const table = taps.quads + 128 * (quad < 3 ? quad : quad - 1);
    const Reg low = reg_load(table);
    const Reg high = reg_load(table + 64);
#pragma GCC unroll 2
    for (int k = 0; k < 2; ++k) {
      const int phase = 2 * kPart + k;
      Reg v[3];
#pragma GCC unroll 3
      for (int i = 0; i < 3; ++i) {
        v[i] = reg_load(quad < 4 ? at[i] + level[quad] + phase : single + (4 * i + phase) * 64);
      }
      keep(v);
      add_quad(k, v, low, &high);
    }
    if (quad % 2 == 1) other_work(quad / 2);
  }
  // Each vertical quad is loaded once: one phase uses it at dx, the next at dx - 1.
  Reg table[4];
#pragma GCC unroll 4
  for (int i = 0; i < 4; ++i) table[i] = reg_load(taps.quads + 512 + 64 * i);
#pragma GCC unroll 8
  for (int dx = -3; dx <= 4; ++dx) {
    Reg v[3];
    const int to = 2 * kPart + dx + 4;  // the 4 is subtracted again
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
      v[i] = reg_load(vertical + (4 * i + to % 4) * kQuadRow + 4 * (to / 4 - 1));
    }
    keep(v);
    if (dx <= 3) add_quad(0, v, table[dx < 0 ? -dx : dx], nullptr);
    if (dx >= -2) add_quad(1, v, table[dx - 1 < 0 ? 1 - dx : dx - 1], nullptr);
    if (dx % 2 == 0 && dx < 4) other_work(dx / 2 + 3);
  }
#pragma GCC unroll 2
  for (int k = 0; k < 2; ++k) {
    const Reg all = _mm512_add_epi32(sums[k].weight, _mm512_set1_epi32(taps.center_weight));
    const RegF scale = _mm512_div_ps(_mm512_set1_ps(1.0F), _mm512_cvtepi32_ps(all));
    const Reg sum[3] = {sums[k].b, sums[k].g, sums[k].r};
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
      // Both factors fit into 16 bits, and the upper half of `weight` is 0.
      const Reg center = _mm512_srai_epi32(c[k][i], 24);
      const Reg difference = _mm512_sub_epi32(_mm512_madd_epi16(center, sums[k].weight), sum[i]);
      const Reg quotient = _mm512_cvtps_epi32(_mm512_mul_ps(_mm512_cvtepi32_ps(difference), scale));
      switch (2 * kPart + k) {
        case 0:
          less[i] = quotient;
          break;
        case 1:
          less[i] =
              _mm512_mask_mov_epi8(less[i], 0x2222222222222222, _mm512_slli_epi32(quotient, 8));
          break;
        case 2:
          less[i] =
              _mm512_mask_mov_epi8(less[i], 0x4444444444444444, _mm512_slli_epi32(quotient, 16));
          break;
        default:
          less[i] =
              _mm512_mask_mov_epi8(less[i], 0x8888888888888888, _mm512_slli_epi32(quotient, 24));
      }
    }
  }
}

TARSIER_VNNI void bilateral9_row(const BilateralTaps& taps, const std::uint8_t* const src[3],
                                 std::uint8_t* const dst[3], int width) {
  static_assert(kQuadRow % 64 == 0);
  alignas(64) std::uint8_t vertical[12 * kQuadRow];
  alignas(64) std::uint8_t single[2][12 * 64];  // for these 64 pixels and the next ones
  const std::ptrdiff_t stride = taps.stride;
  for (int left = 0; left < width; left += kQuadStrip) {
    const int count = width - left < kQuadStrip ? width - left : kQuadStrip;
    // Makes the quads of one plane for 64 pixels. Those of the next pixels are made between the
    // arithmetic of these, because they use other execution units.
    const auto make_vertical = [&](int i, int x) TARSIER_VNNI_INLINE_LAMBDA {
      const std::uint8_t* const at = src[i] + left + x;
      store_quads(at - 2 * stride, at - stride, at + stride, at + 2 * stride,
                  vertical + 4 * i * kQuadRow + kFirstQuad + x, kQuadRow);
    };
    const auto make_single = [&](int i, int x) TARSIER_VNNI_INLINE_LAMBDA {
      const std::uint8_t* const at = src[i] + left + x;
      store_quads(at - 4 * stride, at + 4 * stride, at - 3 * stride + 2, at + 3 * stride + 2,
                  single[x / 64 % 2] + 4 * i * 64, 64);
    };
    for (int i = 0; i < 3; ++i) {
      make_vertical(i, -64);
      make_vertical(i, 0);
      make_vertical(i, 64);
      make_single(i, 0);
    }
    for (int x = 0; x < count; x += 64) {
      const std::uint8_t* const at[3] = {src[0] + left + x, src[1] + left + x, src[2] + left + x};
      const std::uint8_t* const quads = vertical + kFirstQuad + x;
      Reg less[3];
      filter_phases<0>(
          taps, at, quads, single[x / 64 % 2],
          [&](int step) TARSIER_VNNI_INLINE_LAMBDA {
            if (step % 2 == 0) make_vertical(step / 2, x + 128);
          },
          less);
      filter_phases<1>(
          taps, at, quads, single[x / 64 % 2],
          [&](int step) TARSIER_VNNI_INLINE_LAMBDA {
            if (step % 2 == 0) make_single(step / 2, x + 64);
          },
          less);
      for (int i = 0; i < 3; ++i) {
        reg_store(dst[i] + left + x, _mm512_sub_epi8(reg_load(at[i]), less[i]));
      }
    }
  }
}

}  // namespace
