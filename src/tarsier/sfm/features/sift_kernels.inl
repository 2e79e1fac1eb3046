// SPDX-License-Identifier: MIT
// Included once for each instruction set. The including file defines TARSIER_VECTOR_BYTES (16, 32,
// 64) and TARSIER_SIFT (the function's name).
#include "tarsier/sfm/features/sift_kernels.h"

#include <cstring>

namespace tarsier::sfm {
namespace {

using Vector = float __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
using Mask = std::int32_t __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
using Eight = float __attribute__((vector_size(32)));
constexpr int kLanes = TARSIER_VECTOR_BYTES / 4;

template <typename V>
inline V load(const float* p) {
  V v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

template <typename V>
inline void store(float* p, V v) {
  std::memcpy(p, &v, sizeof v);
}

template <typename V>
inline V larger(V a, V b) {
  return a > b ? a : b;
}
template <typename V>
inline V smaller(V a, V b) {
  return a < b ? a : b;
}

// Mirrors an index at both ends of 0..n-1; the end elements are not repeated.
inline int mirrored(int i, int n) {
  while (i < 0 || i >= n) i = i < 0 ? -i : 2 * (n - 1) - i;
  return i;
}

// out[x] = taps[0] middle[x] + sum over k of taps[k] (before[k][x] + behind[k][x]), where before[k]
// and behind[k] are the rows at distance k.
inline void across_rows(const float* const* rows, const float* taps, int radius, int width,
                        float* out) {
  int x = 0;
  for (; x + 2 * kLanes <= width; x += 2 * kLanes) {
    Vector a = taps[0] * load<Vector>(rows[radius] + x);
    Vector b = taps[0] * load<Vector>(rows[radius] + x + kLanes);
    for (int k = 1; k <= radius; ++k) {
      const float* const before = rows[radius - k] + x;
      const float* const behind = rows[radius + k] + x;
      a += taps[k] * (load<Vector>(before) + load<Vector>(behind));
      b += taps[k] * (load<Vector>(before + kLanes) + load<Vector>(behind + kLanes));
    }
    store(out + x, a);
    store(out + x + kLanes, b);
  }
  for (; x < width; ++x) {
    float sum = taps[0] * rows[radius][x];
    for (int k = 1; k <= radius; ++k) sum += taps[k] * (rows[radius - k][x] + rows[radius + k][x]);
    out[x] = sum;
  }
}

inline void along_row(const float* line, const float* taps, int radius, int width, float* out) {
  int x = 0;
  for (; x + 2 * kLanes <= width; x += 2 * kLanes) {
    Vector a = taps[0] * load<Vector>(line + x);
    Vector b = taps[0] * load<Vector>(line + x + kLanes);
    for (int k = 1; k <= radius; ++k) {
      const float* const at = line + x;
      a += taps[k] * (load<Vector>(at - k) + load<Vector>(at + k));
      b += taps[k] * (load<Vector>(at + kLanes - k) + load<Vector>(at + kLanes + k));
    }
    store(out + x, a);
    store(out + x + kLanes, b);
  }
  for (; x < width; ++x) {
    float sum = taps[0] * line[x];
    for (int k = 1; k <= radius; ++k) sum += taps[k] * (line[x - k] + line[x + k]);
    out[x] = sum;
  }
}

void blur(const FloatPlane& in, const float* taps, int radius, int from, int to, float* out,
          float* difference, std::ptrdiff_t stride, float* line) {
  float* const middle = line + kBlurPadding;
  for (int y = from; y < to; ++y) {
    const float* rows[2 * kMaxBlurRadius + 1];
    for (int k = -radius; k <= radius; ++k) rows[radius + k] = in.row(mirrored(y + k, in.height));
    across_rows(rows, taps, radius, in.width, middle);
    for (int k = 1; k <= radius; ++k) {
      middle[-k] = middle[mirrored(-k, in.width)];
      middle[in.width - 1 + k] = middle[mirrored(in.width - 1 + k, in.width)];
    }
    float* const row = out + y * stride;
    along_row(middle, taps, radius, in.width, row);
    if (difference == nullptr) continue;
    const float* const before = in.row(y);
    float* const less = difference + y * stride;
    for (int x = 0; x < in.width; ++x) less[x] = row[x] - before[x];
  }
}

// Whether the value at (x, y) of the middle plane is a max (sign 1) or min (sign -1) of its
// neighbours; equal neighbours are allowed.
inline bool is_extremum(const float* const* rows, int x, float sign) {
  const float value = sign * rows[4][x];
  for (int r = 0; r < 9; ++r)
    for (int dx = -1; dx <= 1; ++dx)
      if (sign * rows[r][x + dx] > value) return false;
  return true;
}

int extrema(const FloatPlane& below, const FloatPlane& middle, const FloatPlane& above, int y,
            int border, float threshold, int* found) {
  const float* rows[9];
  const FloatPlane* const planes[3] = {&below, &middle, &above};
  for (int p = 0; p < 3; ++p)
    for (int dy = -1; dy <= 1; ++dy) rows[3 * p + dy + 1] = planes[p]->row(y + dy);
  const int end = middle.width - border;
  int count = 0;
  int x = border;
  for (; x + kLanes <= end; x += kLanes) {
    const auto value = load<Vector>(rows[4] + x);
    // The neighbours in the same plane reject most candidates.
    Vector high = larger(load<Vector>(rows[4] + x - 1), load<Vector>(rows[4] + x + 1));
    Vector low = smaller(load<Vector>(rows[4] + x - 1), load<Vector>(rows[4] + x + 1));
    for (int r = 3; r <= 5; r += 2) {
      for (int dx = -1; dx <= 1; ++dx) {
        const auto other = load<Vector>(rows[r] + x + dx);
        high = larger(high, other);
        low = smaller(low, other);
      }
    }
    const Mask peak =
        ((value > threshold) & (value >= high)) | ((value < -threshold) & (value <= low));
    std::int64_t any[TARSIER_VECTOR_BYTES / 8];
    std::memcpy(any, &peak, sizeof any);
    std::int64_t all = 0;
    for (const std::int64_t word : any) all |= word;
    if (all == 0) continue;
    for (int k = 0; k < kLanes; ++k)
      if (peak[k] != 0 && is_extremum(rows, x + k, value[k] > 0 ? 1.0F : -1.0F))
        found[count++] = x + k;
  }
  for (; x < end; ++x) {
    const float value = rows[4][x];
    if (value <= threshold && value >= -threshold) continue;
    if (is_extremum(rows, x, value > 0 ? 1.0F : -1.0F)) found[count++] = x;
  }
  return count;
}

inline int clamped(int value, int high) { return value < 0 ? 0 : (value > high ? high : value); }

// Bilinear samples of the image around (x, y), size x size. Column i, row j lies at (x, y) + (i -
// middle) (ax, ay) + (j - middle) (-ay, ax). Outside the image its border pixels are repeated.
template <int kSize, int kStride>
inline void sample(const FloatPlane& image, float x, float y, float ax, float ay, float* out) {
  constexpr float kCenter = (kSize - 1) / 2.0F;
  const float reach = kCenter * ((ax < 0 ? -ax : ax) + (ay < 0 ? -ay : ay));
  const bool inside = x - reach >= 0 && y - reach >= 0 &&
                      x + reach < static_cast<float>(image.width - 1) &&
                      y + reach < static_cast<float>(image.height - 1);
  for (int j = 0; j < kSize; ++j) {
    const float v = static_cast<float>(j) - kCenter;
    const float start_x = x - kCenter * ax - v * ay;
    const float start_y = y - kCenter * ay + v * ax;
    float* const row = out + j * kStride;
    if (inside) {
      for (int i = 0; i < kSize; ++i) {
        const float px = start_x + static_cast<float>(i) * ax;
        const float py = start_y + static_cast<float>(i) * ay;
        const int ix = static_cast<int>(px);
        const int iy = static_cast<int>(py);
        const float fx = px - static_cast<float>(ix);
        const float fy = py - static_cast<float>(iy);
        const float* const p = image.data + iy * image.stride + ix;
        const float* const q = p + image.stride;
        const float top = p[0] + fx * (p[1] - p[0]);
        const float bottom = q[0] + fx * (q[1] - q[0]);
        row[i] = top + fy * (bottom - top);
      }
    } else {
      for (int i = 0; i < kSize; ++i) {
        const float px = start_x + static_cast<float>(i) * ax;
        const float py = start_y + static_cast<float>(i) * ay;
        const int ix = static_cast<int>(px + 65536.0F) - 65536;  // floor
        const int iy = static_cast<int>(py + 65536.0F) - 65536;
        const float fx = px - static_cast<float>(ix);
        const float fy = py - static_cast<float>(iy);
        const float* const p = image.row(clamped(iy, image.height - 1));
        const float* const q = image.row(clamped(iy + 1, image.height - 1));
        const int left = clamped(ix, image.width - 1);
        const int right = clamped(ix + 1, image.width - 1);
        const float top = p[left] + fx * (p[right] - p[left]);
        const float bottom = q[left] + fx * (q[right] - q[left]);
        row[i] = top + fy * (bottom - top);
      }
    }
  }
}

// Magnitude and direction of the gradient of a row of samples at columns 1 to `count`. The
// direction is in turns (0..1), from the row's direction towards the next row. atan is a polynomial
// interpolated at Chebyshev nodes (error up to 6e-7 turns).
template <int kCount>
inline void gradients(const float* before, const float* row, const float* behind, float* magnitude,
                      float* direction) {
  for (int i = 0; i < kCount; ++i) {
    const float dx = row[i + 2] - row[i];
    const float dy = behind[i + 1] - before[i + 1];
    const float ax = __builtin_fabsf(dx);
    const float ay = __builtin_fabsf(dy);
    const float high = (ax > ay ? ax : ay) + 1e-20F;
    const float t = (ax > ay ? ay : ax) / high;
    const float s = t * t;
    float p = -0.002136206F;
    p = p * s + 0.009124441F;
    p = p * s - 0.019275169F;
    p = p * s + 0.031128964F;
    p = p * s - 0.052996787F;
    p = p * s + 0.159154228F;
    float turns = t * p;
    turns = ay > ax ? 0.25F - turns : turns;
    turns = dx < 0 ? 0.5F - turns : turns;
    turns = dy < 0 ? 1.0F - turns : turns;
    magnitude[i] = __builtin_sqrtf(dx * dx + dy * dy);
    direction[i] = turns;
  }
}

constexpr float kSpacing = 0.75F;  // spacing of the samples, in sigma

// exp(-x) for constant x in 0..8.
constexpr float falling(float x) {
  double term = 1;
  double sum = 1;
  for (int k = 1; k < 60; ++k) {
    term *= static_cast<double>(x) / k;
    sum += term;
  }
  return static_cast<float>(1 / sum);
}

constexpr int kOrientationSamples = 13;  // samples across the window: +-4.5 sigma

struct OrientationWeights {
  float value[kOrientationSamples];
};
constexpr OrientationWeights orientation_weights() {
  OrientationWeights weights{};
  for (int i = 0; i < kOrientationSamples; ++i) {
    const float d = static_cast<float>(i - kOrientationSamples / 2) * kSpacing / 1.5F;
    weights.value[i] = falling(d * d / 2);
  }
  return weights;
}
constexpr OrientationWeights kOrientationWeights = orientation_weights();

void orientations(const FloatPlane& image, float x, float y, float sigma,
                  float histogram[kOrientations]) {
  constexpr int kSize = kOrientationSamples + 2;
  constexpr int kStride = 16;
  alignas(64) float samples[kSize * kStride];
  sample<kSize, kStride>(image, x, y, kSpacing * sigma, 0, samples);
  float bins[kOrientations + 2] = {};
  for (int j = 0; j < kOrientationSamples; ++j) {
    const float* const row = samples + (j + 1) * kStride;
    float magnitude[kOrientationSamples];
    float direction[kOrientationSamples];
    gradients<kOrientationSamples>(row - kStride, row, row + kStride, magnitude, direction);
    for (int i = 0; i < kOrientationSamples; ++i) {
      const float weight =
          magnitude[i] * kOrientationWeights.value[i] * kOrientationWeights.value[j];
      const float at = direction[i] * kOrientations;
      const int bin = static_cast<int>(at);  // 0..36
      const float part = weight * (at - static_cast<float>(bin));
      bins[bin] += weight - part;
      bins[bin + 1] += part;
    }
  }
  bins[0] += bins[kOrientations];
  bins[1] += bins[kOrientations + 1];
  for (int k = 0; k < kOrientations; ++k) histogram[k] = bins[k];
}

constexpr int kCellSamples = 4;                  // samples across a cell, which is 3 sigma wide
constexpr int kPatchSamples = 5 * kCellSamples;  // four cells and half a cell on each side
constexpr int kCells = 6;  // four cells and one on each side, which is dropped

// Shares of a sample column (or row) in two neighbouring cells, times a Gaussian with a sigma of
// two cells. Cells are counted from the dropped one.
struct CellShares {
  int cell[kPatchSamples];
  float near[kPatchSamples];
  float far[kPatchSamples];
};
constexpr CellShares cell_shares() {
  CellShares shares{};
  for (int i = 0; i < kPatchSamples; ++i) {
    const float offset = (static_cast<float>(i) - (kPatchSamples - 1) / 2.0F) / kCellSamples;
    const float at = offset + 1.5F + 1;  // cell centres at integers, the dropped cell at 0
    const int cell = static_cast<int>(at);
    const float part = at - static_cast<float>(cell);
    const float weight = falling(offset * offset / 8);
    shares.cell[i] = cell;
    shares.near[i] = weight * (1 - part);
    shares.far[i] = weight * part;
  }
  return shares;
}
constexpr CellShares kCellShares = cell_shares();

void describe(const FloatPlane& image, float x, float y, float sigma, float cosine, float sine,
              float descriptor[kDescriptorLength]) {
  constexpr int kSize = kPatchSamples + 2;
  constexpr int kStride = 24;
  alignas(64) float samples[kSize * kStride];
  const float step = kSpacing * sigma;
  sample<kSize, kStride>(image, x, y, step * cosine, step * sine, samples);
  constexpr Eight kBins = {0, 1, 2, 3, 4, 5, 6, 7};
  Eight cells[kCells][kCells] = {};
  for (int j = 0; j < kPatchSamples; ++j) {
    const float* const row = samples + (j + 1) * kStride;
    float magnitude[kPatchSamples];
    float direction[kPatchSamples];
    gradients<kPatchSamples>(row - kStride, row, row + kStride, magnitude, direction);
    Eight line[kCells] = {};
    for (int i = 0; i < kPatchSamples; ++i) {
      // The direction is shared by the two nearest of eight circular bins.
      Eight away = 8 * direction[i] - kBins;
      away = larger(away, -away);
      away = smaller(away, 8 - away);
      const Eight share = magnitude[i] * larger(1 - away, Eight{});
      line[kCellShares.cell[i]] += kCellShares.near[i] * share;
      line[kCellShares.cell[i] + 1] += kCellShares.far[i] * share;
    }
    for (int c = 1; c < kCells - 1; ++c) {
      cells[kCellShares.cell[j]][c] += kCellShares.near[j] * line[c];
      cells[kCellShares.cell[j] + 1][c] += kCellShares.far[j] * line[c];
    }
  }
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) store(descriptor + (4 * r + c) * 8, cells[r + 1][c + 1]);
}

constexpr SiftKernels kKernels{blur, extrema, orientations, describe};

}  // namespace
}  // namespace tarsier::sfm

const tarsier::sfm::SiftKernels* tarsier::sfm::TARSIER_SIFT() { return &kKernels; }
