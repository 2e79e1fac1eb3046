// SPDX-License-Identifier: MIT
#pragma once

#include <arm_neon.h>
#include <cstdint>

// Vectors of bytes for kernels.inl on arm64; see simd_x86.h.
#define TARSIER_INLINE static inline __attribute__((always_inline))

namespace {

constexpr int kLanes = 16;

constexpr bool kVectorized = true;

struct U8 {
  uint8x16_t v;
};

TARSIER_INLINE U8 load(const std::uint8_t* p) { return {vld1q_u8(p)}; }
TARSIER_INLINE void store(std::uint8_t* p, U8 a) { vst1q_u8(p, a.v); }
TARSIER_INLINE U8 splat(int value) { return {vdupq_n_u8(static_cast<std::uint8_t>(value))}; }
TARSIER_INLINE U8 min(U8 a, U8 b) { return {vminq_u8(a.v, b.v)}; }
TARSIER_INLINE U8 max(U8 a, U8 b) { return {vmaxq_u8(a.v, b.v)}; }
TARSIER_INLINE U8 bit_and(U8 a, U8 b) { return {vandq_u8(a.v, b.v)}; }
TARSIER_INLINE U8 bit_or(U8 a, U8 b) { return {vorrq_u8(a.v, b.v)}; }
TARSIER_INLINE U8 and_not(U8 a, U8 b) { return {vbicq_u8(b.v, a.v)}; }
TARSIER_INLINE U8 add_saturated(U8 a, U8 b) { return {vqaddq_u8(a.v, b.v)}; }
TARSIER_INLINE U8 less_equal(U8 a, U8 b) { return {vcleq_u8(a.v, b.v)}; }

TARSIER_INLINE U8 to_signed(U8 a) { return {veorq_u8(a.v, vdupq_n_u8(128))}; }
TARSIER_INLINE U8 subtract_signed(U8 a, U8 b) {
  return {vreinterpretq_u8_s8(vqsubq_s8(vreinterpretq_s8_u8(a.v), vreinterpretq_s8_u8(b.v)))};
}
TARSIER_INLINE U8 absolute(U8 a) {
  return {vreinterpretq_u8_s8(vabsq_s8(vreinterpretq_s8_u8(a.v)))};
}

struct Table32 {
  uint8x16x2_t all;
};
TARSIER_INLINE Table32 load_table(const std::uint8_t* table) {
  return {{{vld1q_u8(table), vld1q_u8(table + 16)}}};
}
TARSIER_INLINE U8 look_up(const Table32& table, U8 index) {
  return {vqtbl2q_u8(table.all, index.v)};
}

struct Sum16 {
  int16x8_t low;
  int16x8_t high;
};
TARSIER_INLINE Sum16 sum_splat(int value) {
  const int16x8_t v = vdupq_n_s16(static_cast<std::int16_t>(value));
  return {v, v};
}
struct Pair {
  int8x16_t a;
  int8x16_t b;
};
TARSIER_INLINE Pair interleave(U8 a, U8 b) {
  return {vreinterpretq_s8_u8(a.v), vreinterpretq_s8_u8(b.v)};
}
TARSIER_INLINE Sum16 multiply_add(Sum16 sum, const Pair& w, const Pair& d) {
  sum.low = vmlal_s8(sum.low, vget_low_s8(w.a), vget_low_s8(d.a));
  sum.high = vmlal_high_s8(sum.high, w.a, d.a);
  sum.low = vmlal_s8(sum.low, vget_low_s8(w.b), vget_low_s8(d.b));
  sum.high = vmlal_high_s8(sum.high, w.b, d.b);
  return sum;
}
TARSIER_INLINE Sum16 add_pair(Sum16 sum, const Pair& w) {
  sum.low = vaddw_s8(sum.low, vget_low_s8(w.a));
  sum.high = vaddw_high_s8(sum.high, w.a);
  sum.low = vaddw_s8(sum.low, vget_low_s8(w.b));
  sum.high = vaddw_high_s8(sum.high, w.b);
  return sum;
}

struct Reciprocal {
  float32x4_t part[4];
};
TARSIER_INLINE float32x4_t to_float(int16x4_t a) { return vcvtq_f32_s32(vmovl_s16(a)); }
TARSIER_INLINE Reciprocal reciprocal(const Sum16& a) {
  const float32x4_t one = vdupq_n_f32(1.0F);
  return {{vdivq_f32(one, to_float(vget_low_s16(a.low))),
           vdivq_f32(one, to_float(vget_high_s16(a.low))),
           vdivq_f32(one, to_float(vget_low_s16(a.high))),
           vdivq_f32(one, to_float(vget_high_s16(a.high)))}};
}
TARSIER_INLINE int16x4_t scaled(int16x4_t a, float32x4_t factor) {
  return vqmovn_s32(vcvtnq_s32_f32(vmulq_f32(to_float(a), factor)));
}
TARSIER_INLINE U8 subtract_quotient(U8 base, const Sum16& a, const Reciprocal& r) {
  const int16x8_t low =
      vcombine_s16(scaled(vget_low_s16(a.low), r.part[0]), scaled(vget_high_s16(a.low), r.part[1]));
  const int16x8_t high = vcombine_s16(scaled(vget_low_s16(a.high), r.part[2]),
                                      scaled(vget_high_s16(a.high), r.part[3]));
  return {vsubq_u8(base.v, vreinterpretq_u8_s8(vcombine_s8(vqmovn_s16(low), vqmovn_s16(high))))};
}

TARSIER_INLINE Sum16 widen(U8 a) {
  return {vreinterpretq_s16_u16(vmovl_u8(vget_low_u8(a.v))),
          vreinterpretq_s16_u16(vmovl_high_u8(a.v))};
}
TARSIER_INLINE Sum16 operator+(Sum16 a, Sum16 b) {
  return {vaddq_s16(a.low, b.low), vaddq_s16(a.high, b.high)};
}
TARSIER_INLINE Sum16 operator-(Sum16 a, Sum16 b) {
  return {vsubq_s16(a.low, b.low), vsubq_s16(a.high, b.high)};
}
TARSIER_INLINE Sum16 operator*(Sum16 a, int factor) {
  const auto f = static_cast<std::int16_t>(factor);
  return {vmulq_n_s16(a.low, f), vmulq_n_s16(a.high, f)};
}
TARSIER_INLINE Sum16 multiply_low(Sum16 a, Sum16 b) {
  return {vmulq_s16(a.low, b.low), vmulq_s16(a.high, b.high)};
}
TARSIER_INLINE int16x8_t subtract_to_zero(int16x8_t a, int16x8_t b) {
  return vreinterpretq_s16_u16(vqsubq_u16(vreinterpretq_u16_s16(a), vreinterpretq_u16_s16(b)));
}
TARSIER_INLINE Sum16 subtract_to_zero(Sum16 a, Sum16 b) {
  return {subtract_to_zero(a.low, b.low), subtract_to_zero(a.high, b.high)};
}
TARSIER_INLINE bool all_zero(U8 a) { return vmaxvq_u8(a.v) == 0; }
TARSIER_INLINE Sum16 magnitude(Sum16 a) { return {vabsq_s16(a.low), vabsq_s16(a.high)}; }
TARSIER_INLINE U8 pack_saturated(Sum16 a) {
  return {vcombine_u8(vqmovun_s16(a.low), vqmovun_s16(a.high))};
}

template <int kBits>
TARSIER_INLINE Sum16 shift_right(Sum16 a) {
  return {vreinterpretq_s16_u16(vshrq_n_u16(vreinterpretq_u16_s16(a.low), kBits)),
          vreinterpretq_s16_u16(vshrq_n_u16(vreinterpretq_u16_s16(a.high), kBits))};
}
TARSIER_INLINE void store_alternating(std::uint8_t* p, U8 even, U8 odd) {
  vst2q_u8(p, uint8x16x2_t{{even.v, odd.v}});
}
TARSIER_INLINE void split16(const std::uint8_t* bgr, std::uint8_t* b, std::uint8_t* g,
                            std::uint8_t* r) {
  const uint8x16x3_t p = vld3q_u8(bgr);
  const uint8x16_t top = vdupq_n_u8(128);
  vst1q_u8(b, veorq_u8(p.val[0], top));
  vst1q_u8(g, veorq_u8(p.val[1], top));
  vst1q_u8(r, veorq_u8(p.val[2], top));
}
TARSIER_INLINE void join16(std::uint8_t* bgr, const std::uint8_t* b, const std::uint8_t* g,
                           const std::uint8_t* r) {
  vst3q_u8(bgr, uint8x16x3_t{{vld1q_u8(b), vld1q_u8(g), vld1q_u8(r)}});
}

}  // namespace
