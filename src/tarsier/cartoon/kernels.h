// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// The inner loops of the cartoon filters on rows of bytes. They are compiled once for each
// instruction set from one source (kernels.inl) and selected at run time. Their output is identical
// on every instruction set.
//
// Rows: every source and destination row must be readable and writable up to the next multiple of
// kRowSlack past `width` (Plane ensures this). Bytes written beyond `width` are undefined. Source
// rows must be readable to the left as far as the filter reaches.
namespace tarsier::cartoon {

inline constexpr int kRowSlack = 64;  // bytes beyond a row that kernels may access
// Weights of colour distances 0..31; larger distances have weight 0.
inline constexpr int kBilateralTable = 32;

// Neighbours of a bilateral filter, in pairs, grouped into rings of equal distance from the centre.
struct BilateralTaps {
  int rings;
  const std::uint8_t* weights;    // rings x kBilateralTable: spatial times colour weight, 0..127
  const int* ring_end;            // for each ring: number of pairs up to its end
  const std::ptrdiff_t* offsets;  // two per pair, in bytes from the centre
  int center_weight;              // 1..127
  std::ptrdiff_t stride;          // bytes from row to row of the planes
  // Only for diameter 9, otherwise null: tables of single neighbours, kBilateralTable weights each,
  // the last of them 0. Order: dx -4 .. -1 and 1 .. 4 of dy 0; dx -2 .. 1 of dy 3; (0, 4), (0, 4),
  // (2, 3), (2, 3); for dx 0 .. 3 those of dy 2 and 1. Aligned to 64 bytes.
  const std::uint8_t* quads;
};

struct Kernels {
  // False for plain C++: then OpenCV's own bilateral filter is faster.
  bool vectorized;

  // One row of a joint bilateral filter over three planes (Tomasi and Manduchi, ICCV 1998). The
  // planes hold value - 128 as signed bytes:
  //   out = c + round( sum w (v - c) / (center_weight + sum w) ),  w = weights[ring][|db| + |dg| +
  //   |dr|]
  // The sums of w (v - c) must stay within 16 bits (see bilateral.h).
  void (*bilateral_row)(const BilateralTaps& taps, const std::uint8_t* const src[3],
                        std::uint8_t* const dst[3], int width);

  // Exact 7x7 median. `rows` are the 7 rows around the output row, readable from -3. `scratch`
  // holds 7 rows of `scratch_stride` >= width + 6 + 2 kRowSlack bytes.
  void (*median7_row)(const std::uint8_t* const rows[7], std::uint8_t* dst, int width,
                      std::uint8_t* scratch, std::ptrdiff_t scratch_stride);

  // Exact 3x3 median; rows readable from -1.
  void (*median3_row)(const std::uint8_t* const rows[3], std::uint8_t* dst, int width);

  // Laplacian of aperture 5 ([1 0 -2 0 1] x [1 4 6 4 1] plus its transpose), saturated to 0..255;
  // rows readable from -2.
  void (*laplacian5_row)(const std::uint8_t* const rows[5], std::uint8_t* dst, int width);

  // |Scharr x|, or |Scharr x| + |Scharr y| with `both_axes`. Each term and the sum are saturated to
  // 0..255; rows readable from -1.
  void (*scharr_row)(const std::uint8_t* const rows[3], std::uint8_t* dst, int width,
                     bool both_axes);

  // dst = src > threshold ? 0 : 255
  void (*threshold_inverse_row)(const std::uint8_t* src, std::uint8_t* dst, int width,
                                int threshold);

  // dst = 255 where rows[2] is black and the 16 pixels of its 5x5 border are white, else 0. Rows
  // hold only 0 and 255 and are readable from -2.
  void (*lone_black_row)(const std::uint8_t* const rows[5], std::uint8_t* dst, int width);

  // dst = mask, or 255 where any of the surrounding 3x3 pixels of `marks` is not 0; marks readable
  // from -1.
  void (*whiten_row)(const std::uint8_t* mask, const std::uint8_t* const marks[3],
                     std::uint8_t* dst, int width);

  // Converts pixels of three bytes to three planes of value - 128, and back. `bgr` is exactly 3
  // width long.
  void (*split_row)(const std::uint8_t* bgr, std::uint8_t* const dst[3], int width);
  void (*join_row)(const std::uint8_t* const src[3], std::uint8_t* bgr, int width);

  // One row of the doubled image, 2 width pixels of three bytes, as in cv::resize with
  // INTER_LINEAR: 3/4 of the nearer pixel and 1/4 of the other, in each direction. The planes hold
  // value - 128; rows are readable from -1 to width. Where `mask` (2 width bytes; may be null) is
  // 0, the result is black; elsewhere `mask` must be 255.
  void (*enlarge_row)(const std::uint8_t* const near[3], const std::uint8_t* const far[3],
                      const std::uint8_t* mask, std::uint8_t* bgr, int width);

  // The same for one plane of unshifted values, without a mask: 2 width bytes.
  void (*enlarge_plane_row)(const std::uint8_t* near, const std::uint8_t* far, std::uint8_t* dst,
                            int width);

  // bgr = sharp + ((soft - sharp) weight + 127) / 255, rounded towards zero, for pixels of three
  // bytes. Rows of pixels are exactly 3 width long; `weight` has one byte per pixel.
  void (*blend_row)(const std::uint8_t* sharp, const std::uint8_t* soft, const std::uint8_t* weight,
                    std::uint8_t* bgr, int width);
};

// The kernels for simd_level() (core/cpu.h).
[[nodiscard]] const Kernels& kernels();

// One per instruction set; null if this build does not have it.
[[nodiscard]] const Kernels* baseline_kernels();
[[nodiscard]] const Kernels* sse41_kernels();
[[nodiscard]] const Kernels* avx2_kernels();
[[nodiscard]] const Kernels* avx512_kernels();

}  // namespace tarsier::cartoon
