// SPDX-License-Identifier: MIT
// The kernels of kernels.h, written with the vectors of simd_*.h. Included once for each
// instruction set. The including file includes one of these headers and defines TARSIER_KERNELS,
// the name of its accessor function.
//
// This file includes no header of the C++ library. An inline function of it would be compiled with
// the flags of a newer processor, and the linker could use it in the whole program.

namespace {

// --- bilateral filter ---

// Differences c - v saturate at +-127, where the weight is zero in any case. The planes hold value
// - 128, because every instruction set has a saturating subtraction of signed bytes.
struct Neighbour {
  U8 weight;
  U8 b;
  U8 g;
  U8 r;
};

TARSIER_INLINE Neighbour neighbour(const std::uint8_t* b, const std::uint8_t* g,
                                   const std::uint8_t* r, const U8& cb, const U8& cg, const U8& cr,
                                   const Table32& table) {
  Neighbour n;
  n.b = subtract_signed(cb, load(b));
  n.g = subtract_signed(cg, load(g));
  n.r = subtract_signed(cr, load(r));
  const U8 distance = add_saturated(add_saturated(absolute(n.b), absolute(n.g)), absolute(n.r));
  n.weight = look_up(table, distance);
  return n;
}

void bilateral_row(const tarsier::cartoon::BilateralTaps& taps, const std::uint8_t* const src[3],
                   std::uint8_t* const dst[3], int width) {
#if defined(TARSIER_AVX512)
  if (taps.quads != nullptr && __builtin_cpu_supports("avx512vnni")) {
    bilateral9_row(taps, src, dst, width);
    return;
  }
#endif
  for (int x = 0; x < width; x += kLanes) {
    const std::uint8_t* b = src[0] + x;
    const std::uint8_t* g = src[1] + x;
    const std::uint8_t* r = src[2] + x;
    const U8 cb = load(b);
    const U8 cg = load(g);
    const U8 cr = load(r);
    Sum16 weights = sum_splat(taps.center_weight);
    Sum16 sum_b = sum_splat(0);
    Sum16 sum_g = sum_splat(0);
    Sum16 sum_r = sum_splat(0);
    const std::ptrdiff_t* offset = taps.offsets;
    int pair = 0;
    for (int ring = 0; ring < taps.rings; ++ring) {
      const Table32 table = load_table(taps.weights + ring * tarsier::cartoon::kBilateralTable);
      for (; pair < taps.ring_end[ring]; ++pair, offset += 2) {
        const Neighbour p =
            neighbour(b + offset[0], g + offset[0], r + offset[0], cb, cg, cr, table);
        const Neighbour q =
            neighbour(b + offset[1], g + offset[1], r + offset[1], cb, cg, cr, table);
        const Pair w = interleave(p.weight, q.weight);
        weights = add_pair(weights, w);
        sum_b = multiply_add(sum_b, w, interleave(p.b, q.b));
        sum_g = multiply_add(sum_g, w, interleave(p.g, q.g));
        sum_r = multiply_add(sum_r, w, interleave(p.r, q.r));
      }
    }
    const Reciprocal scale = reciprocal(weights);
    store(dst[0] + x, subtract_quotient(cb, sum_b, scale));
    store(dst[1] + x, subtract_quotient(cg, sum_g, scale));
    store(dst[2] + x, subtract_quotient(cr, sum_r, scale));
  }
}

// --- medians ---

TARSIER_INLINE void order(U8& a, U8& b) {
  const U8 least = min(a, b);
  b = max(a, b);
  a = least;
}

// The best known network for 7 inputs, 16 comparators (Knuth, TAOCP 3, 5.3.4). The compiler removes
// comparators with unused results.
TARSIER_INLINE void sort7(U8* v) {
  order(v[0], v[6]), order(v[2], v[3]), order(v[4], v[5]);
  order(v[0], v[2]), order(v[1], v[4]), order(v[3], v[6]);
  order(v[0], v[1]), order(v[2], v[5]), order(v[3], v[4]);
  order(v[1], v[2]), order(v[4], v[6]);
  order(v[2], v[3]), order(v[4], v[5]);
  order(v[1], v[2]), order(v[3], v[4]), order(v[5], v[6]);
}

// Batcher's odd-even merge of two sorted lists of any lengths (Knuth, ibid.).
template <int kM, int kN>
struct Merge {
  TARSIER_INLINE void run(const U8* a, const U8* b, U8* out) {
    constexpr int kEvenA = (kM + 1) / 2;
    constexpr int kEvenB = (kN + 1) / 2;
    constexpr int kOddA = kM / 2;
    constexpr int kOddB = kN / 2;
    constexpr int kEven = kEvenA + kEvenB;
    constexpr int kOdd = kOddA + kOddB;
    U8 even_a[kEvenA];
    U8 even_b[kEvenB];
    U8 odd_a[kOddA + 1];
    U8 odd_b[kOddB + 1];
#pragma GCC unroll 16
    for (int i = 0; i < kM; ++i) (i % 2 == 0 ? even_a : odd_a)[i / 2] = a[i];
#pragma GCC unroll 16
    for (int i = 0; i < kN; ++i) (i % 2 == 0 ? even_b : odd_b)[i / 2] = b[i];
    U8 v[kEven];
    U8 w[kOdd + 1];
    Merge<kEvenA, kEvenB>::run(even_a, even_b, v);
    Merge<kOddA, kOddB>::run(odd_a, odd_b, w);
    out[0] = v[0];
#pragma GCC unroll 16
    for (int i = 0; i < kOdd; ++i) {
      if (i + 1 < kEven) {
        order(w[i], v[i + 1]);
        out[2 * i + 1] = w[i];
        out[2 * i + 2] = v[i + 1];
      } else {
        out[2 * i + 1] = w[i];
      }
    }
    if (kEven == kOdd + 2) out[kM + kN - 1] = v[kEven - 1];
  }
};
template <int kN>
struct Merge<0, kN> {
  TARSIER_INLINE void run(const U8*, const U8* b, U8* out) {
#pragma GCC unroll 16
    for (int i = 0; i < kN; ++i) out[i] = b[i];
  }
};
template <int kM>
struct Merge<kM, 0> {
  TARSIER_INLINE void run(const U8* a, const U8*, U8* out) {
#pragma GCC unroll 16
    for (int i = 0; i < kM; ++i) out[i] = a[i];
  }
};
template <>
struct Merge<0, 0> {
  TARSIER_INLINE void run(const U8*, const U8*, U8*) {}
};
template <>
struct Merge<1, 1> {
  TARSIER_INLINE void run(const U8* a, const U8* b, U8* out) {
    out[0] = min(a[0], b[0]);
    out[1] = max(a[0], b[0]);
  }
};

TARSIER_INLINE void load_sorted7(const std::uint8_t* p, U8* v) {
#pragma GCC unroll 7
  for (int i = 0; i < 7; ++i) v[i] = load(p + i);
  sort7(v);
}

// The 7 columns of the window are sorted, and then the 7 values of equal rank. The value at rank i
// of the columns and rank j of its row has at least (i + 1)(j + 1) - 1 other values below or equal,
// and (7 - i)(7 - j) - 1 above or equal. If either count reaches 25, the value cannot be the median
// (rank 24 of 49). 29 values remain; 10 are known to be below and 10 above. So the median is rank
// 14 of the 29, which form seven sorted lists.
TARSIER_INLINE U8 median49(const std::uint8_t* ranks, std::ptrdiff_t stride) {
  U8 row[7];
  U8 a6[6];
  U8 a8[8];
  U8 a[14];
  {
    U8 first[3];
    U8 second[3];
    load_sorted7(ranks, row);
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) first[i] = row[4 + i];
    load_sorted7(ranks + 6 * stride, row);
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) second[i] = row[i];
    Merge<3, 3>::run(first, second, a6);
  }
  {
    U8 first[4];
    U8 second[4];
    load_sorted7(ranks + stride, row);
#pragma GCC unroll 4
    for (int i = 0; i < 4; ++i) first[i] = row[3 + i];
    load_sorted7(ranks + 5 * stride, row);
#pragma GCC unroll 4
    for (int i = 0; i < 4; ++i) second[i] = row[i];
    Merge<4, 4>::run(first, second, a8);
  }
  Merge<6, 8>::run(a6, a8, a);
  U8 b10[10];
  U8 b[15];
  {
    U8 first[5];
    U8 second[5];
    load_sorted7(ranks + 2 * stride, row);
#pragma GCC unroll 5
    for (int i = 0; i < 5; ++i) first[i] = row[2 + i];
    load_sorted7(ranks + 4 * stride, row);
#pragma GCC unroll 5
    for (int i = 0; i < 5; ++i) second[i] = row[i];
    Merge<5, 5>::run(first, second, b10);
  }
  load_sorted7(ranks + 3 * stride, row);
  Merge<10, 5>::run(b10, row + 1, b);
  // The 15th smallest of both lists: the min over i of the max of a[i - 1] and b[14 - i].
  U8 median = b[14];
#pragma GCC unroll 14
  for (int i = 1; i <= 14; ++i) median = min(median, max(a[i - 1], b[14 - i]));
  return median;
}

void median7_row(const std::uint8_t* const rows[7], std::uint8_t* dst, int width,
                 std::uint8_t* scratch, std::ptrdiff_t scratch_stride) {
  for (int x = 0; x < width + 6; x += kLanes) {
    U8 column[7];
#pragma GCC unroll 7
    for (int i = 0; i < 7; ++i) column[i] = load(rows[i] + x - 3);
    sort7(column);
#pragma GCC unroll 7
    for (int i = 0; i < 7; ++i) store(scratch + i * scratch_stride + x, column[i]);
  }
  for (int x = 0; x < width; x += kLanes) store(dst + x, median49(scratch + x, scratch_stride));
}

TARSIER_INLINE void sort3(U8& a, U8& b, U8& c) {
  order(a, b);
  order(b, c);
  order(a, b);
}

void median3_row(const std::uint8_t* const rows[3], std::uint8_t* dst, int width) {
  for (int x = 0; x < width; x += kLanes) {
    U8 v[3][3];
#pragma GCC unroll 3
    for (int dx = 0; dx < 3; ++dx) {
#pragma GCC unroll 3
      for (int i = 0; i < 3; ++i) v[dx][i] = load(rows[i] + x + dx - 1);
      sort3(v[dx][0], v[dx][1], v[dx][2]);
    }
    U8 low = max(max(v[0][0], v[1][0]), v[2][0]);
    U8 high = min(min(v[0][2], v[1][2]), v[2][2]);
    sort3(v[0][1], v[1][1], v[2][1]);
    sort3(low, v[1][1], high);
    store(dst + x, v[1][1]);
  }
}

// --- lines ---

void laplacian5_row(const std::uint8_t* const rows[5], std::uint8_t* dst, int width) {
  // The two separable kernels add up to
  //   2  4   4  4 2
  //   4  0  -8  0 4
  //   4 -8 -24 -8 4   and its mirror image below: four sums of equal weight.
  for (int x = 0; x < width; x += kLanes) {
    const auto at = [&](int dy, int dx) { return widen(load(rows[2 + dy] + x + dx)); };
    const Sum16 corners = at(-2, -2) + at(-2, 2) + at(2, -2) + at(2, 2);
    const Sum16 sides = at(-2, -1) + at(-2, 0) + at(-2, 1) + at(2, -1) + at(2, 0) + at(2, 1) +
                        at(-1, -2) + at(0, -2) + at(1, -2) + at(-1, 2) + at(0, 2) + at(1, 2);
    const Sum16 cross = at(-1, 0) + at(1, 0) + at(0, -1) + at(0, 1);
    store(dst + x, pack_saturated(corners * 2 + sides * 4 - cross * 8 - at(0, 0) * 24));
  }
}

void scharr_row(const std::uint8_t* const rows[3], std::uint8_t* dst, int width, bool both_axes) {
  for (int x = 0; x < width; x += kLanes) {
    const auto at = [&](int dy, int dx) { return widen(load(rows[1 + dy] + x + dx)); };
    const Sum16 along_x =
        (at(-1, 1) - at(-1, -1) + at(1, 1) - at(1, -1)) * 3 + (at(0, 1) - at(0, -1)) * 10;
    U8 edges = pack_saturated(magnitude(along_x));
    if (both_axes) {
      const Sum16 along_y =
          (at(1, -1) - at(-1, -1) + at(1, 1) - at(-1, 1)) * 3 + (at(1, 0) - at(-1, 0)) * 10;
      edges = add_saturated(edges, pack_saturated(magnitude(along_y)));
    }
    store(dst + x, edges);
  }
}

void threshold_inverse_row(const std::uint8_t* src, std::uint8_t* dst, int width, int threshold) {
  const U8 limit = splat(threshold);
  for (int x = 0; x < width; x += kLanes) store(dst + x, less_equal(load(src + x), limit));
}

void lone_black_row(const std::uint8_t* const rows[5], std::uint8_t* dst, int width) {
  for (int x = 0; x < width; x += kLanes) {
    U8 border = bit_and(load(rows[0] + x - 2), load(rows[4] + x - 2));
#pragma GCC unroll 4
    for (int dx = -1; dx <= 2; ++dx) {
      border = bit_and(border, bit_and(load(rows[0] + x + dx), load(rows[4] + x + dx)));
    }
#pragma GCC unroll 3
    for (int i = 1; i <= 3; ++i) {
      border = bit_and(border, bit_and(load(rows[i] + x - 2), load(rows[i] + x + 2)));
    }
    store(dst + x, and_not(load(rows[2] + x), border));
  }
}

void whiten_row(const std::uint8_t* mask, const std::uint8_t* const marks[3], std::uint8_t* dst,
                int width) {
  for (int x = 0; x < width; x += kLanes) {
    U8 white = load(mask + x);
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
      white = bit_or(white, bit_or(bit_or(load(marks[i] + x - 1), load(marks[i] + x)),
                                   load(marks[i] + x + 1)));
    }
    store(dst + x, white);
  }
}

// --- pixels of three bytes, sixteen at a time ---

// If the width is no multiple of 16 pixels, the last part of a row is copied to the stack. The
// memory behind the caller's rows must not be accessed.
constexpr int kGroup = 16;

void split_row(const std::uint8_t* bgr, std::uint8_t* const dst[3], int width) {
  int x = 0;
  for (; x + kGroup <= width; x += kGroup) {
    split16(bgr + 3 * x, dst[0] + x, dst[1] + x, dst[2] + x);
  }
  for (; x < width; ++x) {
    for (int c = 0; c < 3; ++c) dst[c][x] = static_cast<std::uint8_t>(bgr[3 * x + c] ^ 128U);
  }
}

// Stores sixteen pixels of unsigned planes, or only the first `count`.
TARSIER_INLINE void store_pixels(std::uint8_t* bgr, const std::uint8_t* b, const std::uint8_t* g,
                                 const std::uint8_t* r, int count) {
  if (count >= kGroup) {
    join16(bgr, b, g, r);
    return;
  }
  std::uint8_t group[3 * kGroup];
  join16(group, b, g, r);
  for (int i = 0; i < 3 * count; ++i) bgr[i] = group[i];
}

void join_row(const std::uint8_t* const src[3], std::uint8_t* bgr, int width) {
  std::uint8_t part[3][kLanes];
  for (int x = 0; x < width; x += kLanes) {
    for (int c = 0; c < 3; ++c) store(part[c], to_signed(load(src[c] + x)));
    const int count = width - x < kLanes ? width - x : kLanes;
    for (int i = 0; i < count; i += kGroup) {
      store_pixels(bgr + 3 * (x + i), part[0] + i, part[1] + i, part[2] + i, count - i);
    }
  }
}

// OpenCV's fixed-point arithmetic for weights of 1/4 and 3/4: rows in 1/4, then
// (far / 4 + 3 near / 4 + 2) / 4, each division rounded down.
TARSIER_INLINE U8 between(const Sum16& near, const Sum16& far) {
  return pack_saturated(
      shift_right<2>(shift_right<2>(far) + shift_right<2>(near * 3) + sum_splat(2)));
}

void enlarge_row(const std::uint8_t* const near[3], const std::uint8_t* const far[3],
                 const std::uint8_t* mask, std::uint8_t* bgr, int width) {
  std::uint8_t part[3][2 * kLanes];
  for (int x = 0; x < width; x += kLanes) {
    for (int c = 0; c < 3; ++c) {
      const auto at = [&](const std::uint8_t* row) { return widen(to_signed(load(row + x))); };
      const Sum16 n = at(near[c]) * 3;
      const Sum16 f = at(far[c]) * 3;
      U8 even = between(n + at(near[c] - 1), f + at(far[c] - 1));
      U8 odd = between(n + at(near[c] + 1), f + at(far[c] + 1));
      store_alternating(part[c], even, odd);
    }
    if (mask != nullptr) {
      for (int i = 0; i < 2; ++i) {
        const U8 keep = load(mask + 2 * x + i * kLanes);
        for (int c = 0; c < 3; ++c) {
          std::uint8_t* p = part[c] + i * kLanes;
          store(p, bit_and(load(p), keep));
        }
      }
    }
    const int count = 2 * (width - x) < 2 * kLanes ? 2 * (width - x) : 2 * kLanes;
    for (int i = 0; i < count; i += kGroup) {
      store_pixels(bgr + 3 * (2 * x + i), part[0] + i, part[1] + i, part[2] + i, count - i);
    }
  }
}

void enlarge_plane_row(const std::uint8_t* near, const std::uint8_t* far, std::uint8_t* dst,
                       int width) {
  for (int x = 0; x < width; x += kLanes) {
    const Sum16 n = widen(load(near + x)) * 3;
    const Sum16 f = widen(load(far + x)) * 3;
    store_alternating(dst + 2 * x,
                      between(n + widen(load(near + x - 1)), f + widen(load(far + x - 1))),
                      between(n + widen(load(near + x + 1)), f + widen(load(far + x + 1))));
  }
}

// (x + 127) / 255 rounded towards zero, for x = (to - from) w with |x| <= 255 * 255. Let y = |x| +
// 127 for x > 0, else y = max(|x| - 127, 0). Then the result is y / 255 with the sign of x, and y /
// 255 = (y + 1 + (y + 1) / 256) / 256 for all y below 65535.
TARSIER_INLINE Sum16 blended(const Sum16& from, const Sum16& to, const Sum16& w) {
  const Sum16 up = subtract_to_zero(to, from);
  const Sum16 down = subtract_to_zero(from, to);
  const auto quotient = [](const Sum16& y) {
    const Sum16 above = y + sum_splat(1);
    return shift_right<8>(above + shift_right<8>(above));
  };
  // `up` or `down` is zero, and its term is then zero too: 127 / 255 = max(0 - 127, 0) / 255 = 0.
  return from + quotient(multiply_low(up, w) + sum_splat(127)) -
         quotient(subtract_to_zero(multiply_low(down, w), sum_splat(127)));
}

void blend_row(const std::uint8_t* sharp, const std::uint8_t* soft, const std::uint8_t* weight,
               std::uint8_t* bgr, int width) {
  int x = 0;
  for (; x + kLanes <= width; x += kLanes) {
    const std::uint8_t* const from = sharp + 3 * x;
    const std::uint8_t* const to = soft + 3 * x;
    std::uint8_t* const out = bgr + 3 * x;
    const U8 weights = load(weight + x);
    if (all_zero(weights)) {
      for (int i = 0; i < 3; ++i) store(out + i * kLanes, load(from + i * kLanes));
      continue;
    }
    std::uint8_t each[3 * kLanes];
    for (int i = 0; i < kLanes; i += kGroup) {
      join16(each + 3 * i, weight + x + i, weight + x + i, weight + x + i);
    }
    for (int i = 0; i < 3; ++i) {
      const Sum16 f = widen(load(from + i * kLanes));
      const Sum16 t = widen(load(to + i * kLanes));
      store(out + i * kLanes, pack_saturated(blended(f, t, widen(load(each + i * kLanes)))));
    }
  }
  for (int i = 3 * x; i < 3 * width; ++i) {
    const int from = sharp[i];
    bgr[i] = static_cast<std::uint8_t>(from + ((soft[i] - from) * weight[i / 3] + 127) / 255);
  }
}

constexpr tarsier::cartoon::Kernels kKernels{
    kVectorized, bilateral_row,         median7_row,    median3_row, laplacian5_row,
    scharr_row,  threshold_inverse_row, lone_black_row, whiten_row,  split_row,
    join_row,    enlarge_row,    enlarge_plane_row,           blend_row};

}  // namespace

const tarsier::cartoon::Kernels* tarsier::cartoon::TARSIER_KERNELS() { return &kKernels; }
