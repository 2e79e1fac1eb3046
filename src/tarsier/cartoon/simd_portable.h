// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

// Vectors of bytes for kernels.inl in plain C++, for processors without a header of their own; see
// simd_x86.h.
#define TARSIER_INLINE static inline __attribute__((always_inline))

namespace {

constexpr int kLanes = 16;

constexpr bool kVectorized = false;

struct U8 {
  std::uint8_t v[kLanes];
};

template <typename Op>
TARSIER_INLINE U8 map(Op op) {
  U8 r;
  for (int i = 0; i < kLanes; ++i) r.v[i] = static_cast<std::uint8_t>(op(i));
  return r;
}
TARSIER_INLINE int clamp_to(int x, int low, int high) {
  return x < low ? low : x > high ? high : x;
}
TARSIER_INLINE int as_signed(std::uint8_t x) { return static_cast<std::int8_t>(x); }

TARSIER_INLINE U8 load(const std::uint8_t* p) {
  U8 r;
  std::memcpy(r.v, p, kLanes);
  return r;
}
TARSIER_INLINE void store(std::uint8_t* p, const U8& a) { std::memcpy(p, a.v, kLanes); }
TARSIER_INLINE U8 splat(int value) {
  return map([&](int) { return value; });
}
TARSIER_INLINE U8 min(const U8& a, const U8& b) {
  return map([&](int i) { return a.v[i] < b.v[i] ? a.v[i] : b.v[i]; });
}
TARSIER_INLINE U8 max(const U8& a, const U8& b) {
  return map([&](int i) { return a.v[i] < b.v[i] ? b.v[i] : a.v[i]; });
}
TARSIER_INLINE U8 bit_and(const U8& a, const U8& b) {
  return map([&](int i) { return a.v[i] & b.v[i]; });
}
TARSIER_INLINE U8 bit_or(const U8& a, const U8& b) {
  return map([&](int i) { return a.v[i] | b.v[i]; });
}
TARSIER_INLINE U8 and_not(const U8& a, const U8& b) {
  return map([&](int i) { return ~a.v[i] & b.v[i]; });
}
TARSIER_INLINE U8 add_saturated(const U8& a, const U8& b) {
  return map([&](int i) { return clamp_to(a.v[i] + b.v[i], 0, 255); });
}
TARSIER_INLINE U8 less_equal(const U8& a, const U8& b) {
  return map([&](int i) { return a.v[i] <= b.v[i] ? 255 : 0; });
}
TARSIER_INLINE U8 to_signed(const U8& a) {
  return map([&](int i) { return a.v[i] ^ 128; });
}
TARSIER_INLINE U8 subtract_signed(const U8& a, const U8& b) {
  return map([&](int i) { return clamp_to(as_signed(a.v[i]) - as_signed(b.v[i]), -128, 127); });
}
TARSIER_INLINE U8 absolute(const U8& a) {
  return map([&](int i) { return as_signed(a.v[i]) < 0 ? -as_signed(a.v[i]) : as_signed(a.v[i]); });
}

struct Table32 {
  const std::uint8_t* all;
};
TARSIER_INLINE Table32 load_table(const std::uint8_t* table) { return {table}; }
TARSIER_INLINE U8 look_up(const Table32& table, const U8& index) {
  return map([&](int i) { return index.v[i] < 32 ? table.all[index.v[i]] : 0; });
}

struct Sum16 {
  std::int16_t v[kLanes];
};
template <typename Op>
TARSIER_INLINE Sum16 map16(Op op) {
  Sum16 r;
  for (int i = 0; i < kLanes; ++i) r.v[i] = static_cast<std::int16_t>(op(i));
  return r;
}
TARSIER_INLINE Sum16 sum_splat(int value) {
  return map16([&](int) { return value; });
}
struct Pair {
  U8 a;
  U8 b;
};
TARSIER_INLINE Pair interleave(const U8& a, const U8& b) { return {a, b}; }
TARSIER_INLINE Sum16 multiply_add(const Sum16& sum, const Pair& w, const Pair& d) {
  return map16([&](int i) {
    return sum.v[i] + w.a.v[i] * as_signed(d.a.v[i]) + w.b.v[i] * as_signed(d.b.v[i]);
  });
}
TARSIER_INLINE Sum16 add_pair(const Sum16& sum, const Pair& w) {
  return map16([&](int i) { return sum.v[i] + w.a.v[i] + w.b.v[i]; });
}

struct Reciprocal {
  float v[kLanes];
};
TARSIER_INLINE Reciprocal reciprocal(const Sum16& a) {
  Reciprocal r;
  for (int i = 0; i < kLanes; ++i) r.v[i] = 1.0F / static_cast<float>(a.v[i]);
  return r;
}
TARSIER_INLINE U8 subtract_quotient(const U8& base, const Sum16& a, const Reciprocal& r) {
  return map([&](int i) {
    return base.v[i] - static_cast<int>(std::nearbyintf(static_cast<float>(a.v[i]) * r.v[i]));
  });
}

TARSIER_INLINE Sum16 widen(const U8& a) {
  return map16([&](int i) { return a.v[i]; });
}
TARSIER_INLINE Sum16 operator+(const Sum16& a, const Sum16& b) {
  return map16([&](int i) { return a.v[i] + b.v[i]; });
}
TARSIER_INLINE Sum16 operator-(const Sum16& a, const Sum16& b) {
  return map16([&](int i) { return a.v[i] - b.v[i]; });
}
TARSIER_INLINE Sum16 operator*(const Sum16& a, int factor) {
  return map16([&](int i) { return a.v[i] * factor; });
}
TARSIER_INLINE int without_sign(std::int16_t x) { return static_cast<std::uint16_t>(x); }
TARSIER_INLINE Sum16 multiply_low(const Sum16& a, const Sum16& b) {
  return map16([&](int i) {
    return static_cast<std::uint32_t>(without_sign(a.v[i])) *
           static_cast<std::uint32_t>(without_sign(b.v[i]));
  });
}
TARSIER_INLINE Sum16 subtract_to_zero(const Sum16& a, const Sum16& b) {
  return map16([&](int i) {
    const int d = without_sign(a.v[i]) - without_sign(b.v[i]);
    return d < 0 ? 0 : d;
  });
}
TARSIER_INLINE bool all_zero(const U8& a) {
  int any = 0;
  for (int i = 0; i < kLanes; ++i) any |= a.v[i];
  return any == 0;
}
TARSIER_INLINE Sum16 magnitude(const Sum16& a) {
  return map16([&](int i) { return a.v[i] < 0 ? -a.v[i] : a.v[i]; });
}
TARSIER_INLINE U8 pack_saturated(const Sum16& a) {
  return map([&](int i) { return clamp_to(a.v[i], 0, 255); });
}

template <int kBits>
TARSIER_INLINE Sum16 shift_right(const Sum16& a) {
  return map16([&](int i) { return without_sign(a.v[i]) >> kBits; });
}
TARSIER_INLINE void store_alternating(std::uint8_t* p, const U8& even, const U8& odd) {
  for (int i = 0; i < kLanes; ++i) {
    p[2 * i] = even.v[i];
    p[2 * i + 1] = odd.v[i];
  }
}
TARSIER_INLINE void split16(const std::uint8_t* bgr, std::uint8_t* b, std::uint8_t* g,
                            std::uint8_t* r) {
  for (int i = 0; i < 16; ++i) {
    b[i] = static_cast<std::uint8_t>(bgr[3 * i] ^ 128U);
    g[i] = static_cast<std::uint8_t>(bgr[3 * i + 1] ^ 128U);
    r[i] = static_cast<std::uint8_t>(bgr[3 * i + 2] ^ 128U);
  }
}
TARSIER_INLINE void join16(std::uint8_t* bgr, const std::uint8_t* b, const std::uint8_t* g,
                           const std::uint8_t* r) {
  for (int i = 0; i < 16; ++i) {
    bgr[3 * i] = b[i];
    bgr[3 * i + 1] = g[i];
    bgr[3 * i + 2] = r[i];
  }
}

}  // namespace
