// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <immintrin.h>

// Vectors of bytes (U8) and sums of 16-bit products (Sum16) for kernels.inl. The including file
// defines one of TARSIER_AVX512, TARSIER_AVX2, TARSIER_SSE41 and is compiled with the flags of that
// instruction set. Everything has internal linkage, so that the linker cannot use a function
// compiled for a newer processor in the whole program.
#define TARSIER_INLINE static inline __attribute__((always_inline))

namespace {

#if defined(TARSIER_AVX512)
using Reg = __m512i;
using RegF = __m512;
#define TARSIER_OP(name) _mm512_##name
constexpr int kLanes = 64;
TARSIER_INLINE Reg reg_load(const void* p) { return _mm512_loadu_si512(p); }
TARSIER_INLINE void reg_store(void* p, Reg a) { _mm512_storeu_si512(p, a); }
#elif defined(TARSIER_AVX2)
using Reg = __m256i;
using RegF = __m256;
#define TARSIER_OP(name) _mm256_##name
constexpr int kLanes = 32;
TARSIER_INLINE Reg reg_load(const void* p) {
  return _mm256_loadu_si256(static_cast<const __m256i*>(p));
}
TARSIER_INLINE void reg_store(void* p, Reg a) { _mm256_storeu_si256(static_cast<__m256i*>(p), a); }
#else
using Reg = __m128i;
using RegF = __m128;
#define TARSIER_OP(name) _mm_##name
constexpr int kLanes = 16;
TARSIER_INLINE Reg reg_load(const void* p) {
  return _mm_loadu_si128(static_cast<const __m128i*>(p));
}
TARSIER_INLINE void reg_store(void* p, Reg a) { _mm_storeu_si128(static_cast<__m128i*>(p), a); }
#endif

constexpr bool kVectorized = true;

struct U8 {
  Reg v;
};

TARSIER_INLINE U8 load(const std::uint8_t* p) { return {reg_load(p)}; }
TARSIER_INLINE void store(std::uint8_t* p, U8 a) { reg_store(p, a.v); }
TARSIER_INLINE U8 splat(int value) { return {TARSIER_OP(set1_epi8)(static_cast<char>(value))}; }
TARSIER_INLINE U8 min(U8 a, U8 b) { return {TARSIER_OP(min_epu8)(a.v, b.v)}; }
TARSIER_INLINE U8 max(U8 a, U8 b) { return {TARSIER_OP(max_epu8)(a.v, b.v)}; }
TARSIER_INLINE U8 bit_and(U8 a, U8 b) { return {a.v & b.v}; }
TARSIER_INLINE U8 bit_or(U8 a, U8 b) { return {a.v | b.v}; }
TARSIER_INLINE U8 and_not(U8 a, U8 b) { return {~a.v & b.v}; }  // ~a & b
TARSIER_INLINE U8 add_saturated(U8 a, U8 b) { return {TARSIER_OP(adds_epu8)(a.v, b.v)}; }

// 255 where a <= b, else 0 (unsigned).
TARSIER_INLINE U8 less_equal(U8 a, U8 b) {
#if defined(TARSIER_AVX512)
  return {_mm512_movm_epi8(_mm512_cmple_epu8_mask(a.v, b.v))};
#else
  return {TARSIER_OP(cmpeq_epi8)(TARSIER_OP(min_epu8)(a.v, b.v), a.v)};
#endif
}

// Bytes minus 128 as signed numbers; differences of two of them saturate to -128..127.
TARSIER_INLINE U8 to_signed(U8 a) { return {TARSIER_OP(sub_epi8)(a.v, splat(128).v)}; }
TARSIER_INLINE U8 subtract_signed(U8 a, U8 b) { return {TARSIER_OP(subs_epi8)(a.v, b.v)}; }
TARSIER_INLINE U8 absolute(U8 a) { return {TARSIER_OP(abs_epi8)(a.v)}; }

// Lookup in a table of 32 bytes; 0 for indices of 32 and more.
struct Table32 {
#if defined(TARSIER_AVX512)
  Reg all;
#else
  Reg low;
  Reg high;
#endif
};
TARSIER_INLINE Table32 load_table(const std::uint8_t* table) {
#if defined(TARSIER_AVX512)
  return {_mm512_zextsi256_si512(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(table)))};
#else
  const __m128i low = _mm_loadu_si128(reinterpret_cast<const __m128i*>(table));
  const __m128i high = _mm_loadu_si128(reinterpret_cast<const __m128i*>(table + 16));
#if defined(TARSIER_AVX2)
  return {_mm256_broadcastsi128_si256(low ^ high), _mm256_broadcastsi128_si256(high)};
#else
  return {low ^ high, high};
#endif
#endif
}
TARSIER_INLINE U8 look_up(const Table32& table, U8 index) {
#if defined(TARSIER_AVX512)
  return {_mm512_permutexvar_epi8(_mm512_min_epu8(index.v, _mm512_set1_epi8(63)), table.all)};
#else
  // pshufb gives 0 if the index has its top bit set; otherwise the low four bits select. The
  // saturated sums set the top bit from 16 and from 32 on. Below 16 both halves answer, and `low`
  // cancels `high`.
  const Reg in_low = TARSIER_OP(adds_epu8)(index.v, TARSIER_OP(set1_epi8)(112));
  const Reg in_high = TARSIER_OP(adds_epu8)(index.v, TARSIER_OP(set1_epi8)(96));
  return {TARSIER_OP(shuffle_epi8)(table.low, in_low) ^
          TARSIER_OP(shuffle_epi8)(table.high, in_high)};
#endif
}

// Two registers of 16-bit numbers, one number per byte lane. The distribution of the lanes over the
// registers depends on the instruction set; pack() reverses interleave.
struct Sum16 {
  Reg low;
  Reg high;
};
TARSIER_INLINE Sum16 sum_splat(int value) {
  const Reg v = TARSIER_OP(set1_epi16)(static_cast<short>(value));
  return {v, v};
}
// Weights of a pair of neighbours, prepared for multiply_add.
struct Pair {
  Reg low;
  Reg high;
};
TARSIER_INLINE Pair interleave(U8 a, U8 b) {
  return {TARSIER_OP(unpacklo_epi8)(a.v, b.v), TARSIER_OP(unpackhi_epi8)(a.v, b.v)};
}
// sum += w.a * d.a + w.b * d.b with w unsigned (<= 127) and d signed.
TARSIER_INLINE Sum16 multiply_add(Sum16 sum, const Pair& w, const Pair& d) {
  return {TARSIER_OP(add_epi16)(sum.low, TARSIER_OP(maddubs_epi16)(w.low, d.low)),
          TARSIER_OP(add_epi16)(sum.high, TARSIER_OP(maddubs_epi16)(w.high, d.high))};
}
// sum += w.a + w.b
TARSIER_INLINE Sum16 add_pair(Sum16 sum, const Pair& w) {
  const Reg one = TARSIER_OP(set1_epi8)(1);
  return {TARSIER_OP(add_epi16)(sum.low, TARSIER_OP(maddubs_epi16)(w.low, one)),
          TARSIER_OP(add_epi16)(sum.high, TARSIER_OP(maddubs_epi16)(w.high, one))};
}

// 1 / x of 16-bit numbers, in single precision.
struct Reciprocal {
  RegF part[4];
};
TARSIER_INLINE Reg widen_low(Reg a) {
  return TARSIER_OP(srai_epi32)(TARSIER_OP(unpacklo_epi16)(a, a), 16);
}
TARSIER_INLINE Reg widen_high(Reg a) {
  return TARSIER_OP(srai_epi32)(TARSIER_OP(unpackhi_epi16)(a, a), 16);
}
TARSIER_INLINE Reciprocal reciprocal(const Sum16& a) {
  const RegF one = TARSIER_OP(set1_ps)(1.0F);
  return {{TARSIER_OP(div_ps)(one, TARSIER_OP(cvtepi32_ps)(widen_low(a.low))),
           TARSIER_OP(div_ps)(one, TARSIER_OP(cvtepi32_ps)(widen_high(a.low))),
           TARSIER_OP(div_ps)(one, TARSIER_OP(cvtepi32_ps)(widen_low(a.high))),
           TARSIER_OP(div_ps)(one, TARSIER_OP(cvtepi32_ps)(widen_high(a.high)))}};
}
TARSIER_INLINE Reg scaled(Reg wide, RegF factor) {
  return TARSIER_OP(cvtps_epi32)(TARSIER_OP(mul_ps)(TARSIER_OP(cvtepi32_ps)(wide), factor));
}
// base - round(a * r), bytes; rounds to nearest, ties to even. |a * r| must be below 128.
TARSIER_INLINE U8 subtract_quotient(U8 base, const Sum16& a, const Reciprocal& r) {
  const Reg low = TARSIER_OP(packs_epi32)(scaled(widen_low(a.low), r.part[0]),
                                          scaled(widen_high(a.low), r.part[1]));
  const Reg high = TARSIER_OP(packs_epi32)(scaled(widen_low(a.high), r.part[2]),
                                           scaled(widen_high(a.high), r.part[3]));
  return {TARSIER_OP(sub_epi8)(base.v, TARSIER_OP(packs_epi16)(low, high))};
}

// 16-bit arithmetic for derivative filters.
TARSIER_INLINE Sum16 widen(U8 a) {  // zero extended
  const Reg zero = splat(0).v;
  return {TARSIER_OP(unpacklo_epi8)(a.v, zero), TARSIER_OP(unpackhi_epi8)(a.v, zero)};
}
TARSIER_INLINE Sum16 operator+(Sum16 a, Sum16 b) {
  return {TARSIER_OP(add_epi16)(a.low, b.low), TARSIER_OP(add_epi16)(a.high, b.high)};
}
TARSIER_INLINE Sum16 operator-(Sum16 a, Sum16 b) {
  return {TARSIER_OP(sub_epi16)(a.low, b.low), TARSIER_OP(sub_epi16)(a.high, b.high)};
}
TARSIER_INLINE Sum16 operator*(Sum16 a, int factor) {
  const Reg f = TARSIER_OP(set1_epi16)(static_cast<short>(factor));
  return {TARSIER_OP(mullo_epi16)(a.low, f), TARSIER_OP(mullo_epi16)(a.high, f)};
}
// The low 16 bits of the products of unsigned numbers.
TARSIER_INLINE Sum16 multiply_low(Sum16 a, Sum16 b) {
  return {TARSIER_OP(mullo_epi16)(a.low, b.low), TARSIER_OP(mullo_epi16)(a.high, b.high)};
}
// max(a - b, 0) of unsigned numbers.
TARSIER_INLINE Sum16 subtract_to_zero(Sum16 a, Sum16 b) {
  return {TARSIER_OP(subs_epu16)(a.low, b.low), TARSIER_OP(subs_epu16)(a.high, b.high)};
}
TARSIER_INLINE bool all_zero(U8 a) {
#if defined(TARSIER_AVX512)
  return _mm512_test_epi8_mask(a.v, a.v) == 0;
#elif defined(TARSIER_AVX2)
  return _mm256_testz_si256(a.v, a.v) != 0;
#else
  return _mm_testz_si128(a.v, a.v) != 0;
#endif
}
TARSIER_INLINE Sum16 magnitude(Sum16 a) {
  return {TARSIER_OP(abs_epi16)(a.low), TARSIER_OP(abs_epi16)(a.high)};
}
TARSIER_INLINE U8 pack_saturated(Sum16 a) {  // to 0..255
  return {TARSIER_OP(packus_epi16)(a.low, a.high)};
}

template <int kBits>
TARSIER_INLINE Sum16 shift_right(Sum16 a) {  // of unsigned numbers
  return {TARSIER_OP(srli_epi16)(a.low, kBits), TARSIER_OP(srli_epi16)(a.high, kBits)};
}

// even[0], odd[0], even[1], odd[1] ..: 2 kLanes bytes.
TARSIER_INLINE void store_alternating(std::uint8_t* p, U8 even, U8 odd) {
  const Reg low = TARSIER_OP(unpacklo_epi8)(even.v, odd.v);
  const Reg high = TARSIER_OP(unpackhi_epi8)(even.v, odd.v);
#if defined(TARSIER_AVX512)
  const Reg first = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
  const Reg second = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
  reg_store(p, _mm512_permutex2var_epi64(low, first, high));
  reg_store(p + kLanes, _mm512_permutex2var_epi64(low, second, high));
#elif defined(TARSIER_AVX2)
  reg_store(p, _mm256_permute2x128_si256(low, high, 0x20));
  reg_store(p + kLanes, _mm256_permute2x128_si256(low, high, 0x31));
#else
  reg_store(p, low);
  reg_store(p + kLanes, high);
#endif
}

// Shuffles for sixteen pixels of three bytes: source and target byte of each register; 0x80 gives
// 0.
struct PixelShuffles {
  alignas(16) std::uint8_t join[3][3][16];   // [register of pixels][plane]
  alignas(16) std::uint8_t split[3][3][16];  // [plane][register of pixels]
};
constexpr PixelShuffles pixel_shuffles() {
  PixelShuffles s{};
  for (int v = 0; v < 3; ++v) {
    for (int c = 0; c < 3; ++c) {
      for (int i = 0; i < 16; ++i) {
        const int from = 16 * v + i;
        s.join[v][c][i] = static_cast<std::uint8_t>(from % 3 == c ? from / 3 : 0x80);
        const int to = 3 * i + c;
        s.split[c][v][i] = static_cast<std::uint8_t>(to / 16 == v ? to % 16 : 0x80);
      }
    }
  }
  return s;
}
constexpr PixelShuffles kPixelShuffles = pixel_shuffles();
TARSIER_INLINE __m128i load16(const std::uint8_t* p) {
  return _mm_loadu_si128(reinterpret_cast<const __m128i*>(p));
}
TARSIER_INLINE void store16(std::uint8_t* p, __m128i a) {
  _mm_storeu_si128(reinterpret_cast<__m128i*>(p), a);
}
TARSIER_INLINE __m128i gather3(__m128i a, __m128i b, __m128i c, const std::uint8_t (*which)[16]) {
  return _mm_or_si128(
      _mm_or_si128(_mm_shuffle_epi8(a, load16(which[0])), _mm_shuffle_epi8(b, load16(which[1]))),
      _mm_shuffle_epi8(c, load16(which[2])));
}
// Converts pixels to planes of value - 128.
TARSIER_INLINE void split16(const std::uint8_t* bgr, std::uint8_t* b, std::uint8_t* g,
                            std::uint8_t* r) {
  const __m128i p0 = load16(bgr);
  const __m128i p1 = load16(bgr + 16);
  const __m128i p2 = load16(bgr + 32);
  const __m128i top = _mm_set1_epi8(static_cast<char>(0x80));
  store16(b, _mm_xor_si128(gather3(p0, p1, p2, kPixelShuffles.split[0]), top));
  store16(g, _mm_xor_si128(gather3(p0, p1, p2, kPixelShuffles.split[1]), top));
  store16(r, _mm_xor_si128(gather3(p0, p1, p2, kPixelShuffles.split[2]), top));
}
// Converts planes to pixels, unchanged.
TARSIER_INLINE void join16(std::uint8_t* bgr, const std::uint8_t* b, const std::uint8_t* g,
                           const std::uint8_t* r) {
  const __m128i vb = load16(b);
  const __m128i vg = load16(g);
  const __m128i vr = load16(r);
  store16(bgr, gather3(vb, vg, vr, kPixelShuffles.join[0]));
  store16(bgr + 16, gather3(vb, vg, vr, kPixelShuffles.join[1]));
  store16(bgr + 32, gather3(vb, vg, vr, kPixelShuffles.join[2]));
}

}  // namespace
