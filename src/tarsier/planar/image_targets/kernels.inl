// SPDX-License-Identifier: MIT
// Included once for each instruction set. The including file defines TARSIER_TARGET_KERNELS (the
// function's name). The compiler vectorises these plain loops.
#include "tarsier/planar/image_targets/kernels.h"

#include <cmath>
#include <cstdlib>

namespace tarsier::planar::image_targets {
namespace {

void hessian_row(const std::uint8_t* const rows[5], int n, int* __restrict out) {
  const std::uint8_t* __restrict a = rows[0];
  const std::uint8_t* __restrict b = rows[2];
  const std::uint8_t* __restrict c = rows[4];
  for (int x = 0; x < n; ++x) {
    const int twice = 2 * b[x];
    const int xx = b[x - 2] + b[x + 2] - twice;
    const int yy = a[x] + c[x] - twice;
    const int xy = a[x - 2] + c[x + 2] - a[x + 2] - c[x - 2];
    out[x] = 16 * xx * yy - xy * xy;
  }
}

void maxima(const int* __restrict above, const int* __restrict here, const int* __restrict below,
            int n, int bound, std::uint8_t* __restrict out) {
  for (int x = 1; x < n - 1; ++x) {
    const int v = here[x];
    int before = above[x - 1] > above[x] ? above[x - 1] : above[x];
    before = above[x + 1] > before ? above[x + 1] : before;
    before = here[x - 1] > before ? here[x - 1] : before;
    int after = below[x - 1] > below[x] ? below[x - 1] : below[x];
    after = below[x + 1] > after ? below[x + 1] : after;
    after = here[x + 1] > after ? here[x + 1] : after;
    out[x] = static_cast<std::uint8_t>((v > before) & (v >= after) & (v >= bound));
  }
}

void sample(const std::uint8_t* image, int stride, int x, int y, int dx, int dy, float* out) {
  for (int r = 0; r < kSampleSide; ++r) {
    int u = x - dy * r;
    int v = y + dx * r;
    for (int c = 0; c < kSampleSide; ++c) {
      const std::uint8_t* p = image + (v >> 16) * stride + (u >> 16);
      const int fu = (u >> 8) & 255;
      const int fv = (v >> 8) & 255;
      const int top = (p[0] << 8) + fu * (p[1] - p[0]);
      const int bottom = (p[stride] << 8) + fu * (p[stride + 1] - p[stride]);
      out[c] = static_cast<float>((top << 8) + fv * (bottom - top)) * (1.0F / 65536);
      u += dx;
      v += dy;
    }
    out += kSampleSide;
  }
}

constexpr int kInner = kSampleSide - 2;
constexpr int kRow = 32;  // floats in a row of maps: a whole number of vectors

struct Weights {
  // Weight of each inner row (or column) in each of 4 cells: triangles that reach 1.15 spacings to
  // each side, times one Gaussian.
  alignas(64) float cell[4][kInner];
  Weights() {
    for (int k = 0; k < 4; ++k)
      for (int i = 0; i < kInner; ++i) {
        const double at = (i + 0.5) * 4 / kInner - 0.5;
        const double triangle = std::fmax(0.0, 1 - std::fabs(at - k) / 1.15);
        const double off = (at - 1.5) / 2.2;
        cell[k][i] = static_cast<float>(triangle * std::exp(-0.5 * off * off));
      }
  }
};

void pool(const float* samples, float* out) {
  static const Weights weights;
  constexpr float kHalf = 0.70710678F;
  // First pools the rows into 4 bands; sums over the columns afterwards.
  alignas(64) float bands[4][8][kRow] = {};
  for (int y = 0; y < kInner; ++y) {
    const float* __restrict above = samples + y * kSampleSide + 1;
    const float* __restrict here = above + kSampleSide;
    const float* __restrict below = here + kSampleSide;
    alignas(64) float maps[8][kRow];
    for (int x = 0; x < kInner; ++x) {
      const float gx = here[x + 1] - here[x - 1];
      const float gy = below[x] - above[x];
      const float p = (gx + gy) * kHalf;
      const float q = (gy - gx) * kHalf;
      const float inverse = 1 / std::sqrt(gx * gx + gy * gy + 1e-3F);
      // Squared component divided by the magnitude: narrows the response to one direction.
      const float gx2 = gx * gx * inverse;
      const float gy2 = gy * gy * inverse;
      const float p2 = p * p * inverse;
      const float q2 = q * q * inverse;
      maps[0][x] = gx > 0 ? gx2 : 0;
      maps[4][x] = gx > 0 ? 0 : gx2;
      maps[2][x] = gy > 0 ? gy2 : 0;
      maps[6][x] = gy > 0 ? 0 : gy2;
      maps[1][x] = p > 0 ? p2 : 0;
      maps[5][x] = p > 0 ? 0 : p2;
      maps[3][x] = q > 0 ? q2 : 0;
      maps[7][x] = q > 0 ? 0 : q2;
    }
    for (int k = 0; k < 4; ++k) {
      const float w = weights.cell[k][y];
      if (w == 0) continue;
      for (int d = 0; d < 8; ++d)
        for (int x = 0; x < kInner; ++x) bands[k][d][x] += w * maps[d][x];
    }
  }
  for (int k = 0; k < 4; ++k)
    for (int d = 0; d < 8; ++d)
      for (int m = 0; m < 4; ++m) {
        float sum = 0;
        for (int x = 0; x < kInner; ++x) sum += weights.cell[m][x] * bands[k][d][x];
        out[(k * 4 + m) * 8 + d] = sum;
      }
}

// Every second pixel of a disk, as the black fields of a chess board. The image is smooth enough at
// this level.
struct Disk {
  static constexpr int kPoints = 144;  // a whole number of vectors
  int x[kPoints] = {};
  int y[kPoints] = {};
  alignas(64) float weight[kPoints] = {};
  int count = 0;
  Disk() {
    for (int v = -kDirectionRadius; v <= kDirectionRadius; ++v)
      for (int u = -kDirectionRadius; u <= kDirectionRadius; ++u) {
        const double r2 = u * u + v * v;
        if (r2 > (kDirectionRadius + 0.4) * (kDirectionRadius + 0.4) || (u + v) % 2 != 0 ||
            count == kPoints) {
          continue;
        }
        x[count] = u;
        y[count] = v;
        weight[count++] = static_cast<float>(std::exp(-r2 / 32));
      }
  }
};

void directions(const std::uint8_t* center, int stride, float* histogram) {
  static const Disk disk;
  constexpr int n = Disk::kPoints;
  alignas(64) int gx[n];
  alignas(64) int gy[n];
  for (int i = 0; i < n; ++i) {
    const std::uint8_t* p = center + disk.y[i] * stride + disk.x[i];
    gx[i] = p[1] - p[-1];
    gy[i] = p[stride] - p[-stride];
  }
  alignas(64) int bin[n];
  alignas(64) float strength[n];
  for (int i = 0; i < n; ++i) {
    const auto x = static_cast<float>(gx[i]);
    const auto y = static_cast<float>(gy[i]);
    const float ax = std::fabs(x);
    const float ay = std::fabs(y);
    const float small = ax < ay ? ax : ay;
    const float large = ax < ay ? ay : ax;
    const float t = small / (large + 1e-9F);
    const float t2 = t * t;
    // atan with an error of at most 0.3 degrees.
    float a = t * (0.99978784F + t2 * (-0.325808F + t2 * (0.15557865F - 0.0443265F * t2)));
    a = ay > ax ? 1.57079637F - a : a;
    a = x < 0 ? 3.14159274F - a : a;
    a = y < 0 ? -a : a;
    const int b = static_cast<int>((a + 3.14159274F) * (kDirections / 6.28318531F));
    bin[i] = b < kDirections ? b : 0;
    strength[i] = disk.weight[i] * std::sqrt(x * x + y * y);
  }
  float second[kDirections] = {};  // two tables, since neighbours often fall in the same bin
  for (int i = 0; i < n; i += 2) {
    histogram[bin[i]] += strength[i];
    second[bin[i + 1]] += strength[i + 1];
  }
  for (int k = 0; k < kDirections; ++k) histogram[k] += second[k];
}

int search(const Sketch& one, const SketchBlock* blocks, int n, int bound, int room,
           std::int32_t* index, std::uint16_t* distance) {
  int found = 0;
  const int count = (n + 15) / 16;
  for (int b = 0; b < count; ++b) {
    const SketchBlock& block = blocks[b];
    alignas(64) std::uint64_t bits[16];
    for (int i = 0; i < 16; ++i) {
      bits[i] = static_cast<std::uint64_t>(__builtin_popcountll(block.words[0][i] ^ one[0])) +
                static_cast<std::uint64_t>(__builtin_popcountll(block.words[1][i] ^ one[1])) +
                static_cast<std::uint64_t>(__builtin_popcountll(block.words[2][i] ^ one[2])) +
                static_cast<std::uint64_t>(__builtin_popcountll(block.words[3][i] ^ one[3]));
    }
    std::uint64_t least = bits[0];
    for (int i = 1; i < 16; ++i) least = bits[i] < least ? bits[i] : least;
    if (least > static_cast<std::uint64_t>(bound)) continue;
    const int end = n - b * 16 < 16 ? n - b * 16 : 16;
    for (int i = 0; i < end; ++i) {
      if (bits[i] > static_cast<std::uint64_t>(bound)) continue;
      if (found == room) return found;
      index[found] = b * 16 + i;
      distance[found++] = static_cast<std::uint16_t>(bits[i]);
    }
  }
  return found;
}

int distance(const std::uint8_t* __restrict a, const std::uint8_t* __restrict b) {
  int sum = 0;
  for (int i = 0; i < kDescriptorSize; ++i) {
    const int d = a[i] - b[i];
    sum += d * d;
  }
  return sum;
}

constexpr Kernels kTable = {hessian_row, maxima, sample, pool, directions, search, distance};

}  // namespace
}  // namespace tarsier::planar::image_targets

const tarsier::planar::image_targets::Kernels* tarsier::planar::image_targets::TARSIER_TARGET_KERNELS() { return &kTable; }
