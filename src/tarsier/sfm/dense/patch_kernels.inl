// SPDX-License-Identifier: MIT
// Included once for each instruction set. The including file defines TARSIER_VECTOR_BYTES (16, 32,
// 64) and TARSIER_PATCH_KERNELS (the function's name).
#include "tarsier/sfm/dense/patch_kernels.h"

#include <cstring>
#if TARSIER_VECTOR_BYTES > 16
#include <immintrin.h>
#endif

namespace tarsier::sfm {
namespace {

using Vector = float __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
using Integers = std::int32_t __attribute__((vector_size(TARSIER_VECTOR_BYTES)));
constexpr int kLanes = TARSIER_VECTOR_BYTES / 4;
constexpr float kNoise = 2;

struct Offsets {
  alignas(64) float x[kPatchSamples];
  alignas(64) float y[kPatchSamples];
  float spatial[kPatchSamples];
  float tonal[256];
};

// exp() as a series. std::exp is not constexpr. And this file must not contain an inline function
// that the linker could use in other files.
constexpr float exponential(double x) {
  double half = x / 64;
  double sum = 1;
  double term = 1;
  for (int i = 1; i < 16; ++i) sum += term *= half / i;
  for (int i = 0; i < 6; ++i) sum *= sum;
  return static_cast<float>(sum);
}

constexpr Offsets make_offsets() {
  Offsets offsets{};
  int i = 0;
  for (int y = -kPatchRadius; y <= kPatchRadius; y += 2) {
    for (int x = -kPatchRadius; x <= kPatchRadius; x += 2) {
      if (x * x + y * y == 2 * kPatchRadius * kPatchRadius) continue;
      offsets.x[i] = static_cast<float>(x);
      offsets.y[i] = static_cast<float>(y);
      offsets.spatial[i] = exponential(-(x * x + y * y) / 50.0);
      ++i;
    }
  }
  for (int d = 0; d < 256; ++d) offsets.tonal[d] = exponential(-d * d / (2 * 51.0 * 51.0));
  return offsets;
}

constexpr Offsets kOffsets = make_offsets();

inline Vector load(const float* p) {
  Vector v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline Integers gather(const std::uint32_t* data, Integers index) {
#if TARSIER_VECTOR_BYTES == 64
  return reinterpret_cast<Integers>(
      _mm512_i32gather_epi32(reinterpret_cast<__m512i>(index), data, 4));
#elif TARSIER_VECTOR_BYTES == 32
  return reinterpret_cast<Integers>(_mm256_i32gather_epi32(reinterpret_cast<const int*>(data),
                                                           reinterpret_cast<__m256i>(index), 4));
#else
  Integers values;
  for (int i = 0; i < kLanes; ++i) values[i] = static_cast<std::int32_t>(data[index[i]]);
  return values;
#endif
}

inline float sum_of(Vector v) {
  float sum[kLanes];
  std::memcpy(sum, &v, sizeof v);
  for (int n = kLanes / 2; n > 0; n /= 2)
    for (int i = 0; i < n; ++i) sum[i] += sum[i + n];
  return sum[0];
}

inline float root_of(float x) { return __builtin_sqrtf(x); }

// Bilinear grey levels at (u, v) inside 0..width - 1 and 0..height - 1, upper limits excluded.
inline Vector between(const GrayQuads& image, Vector u, Vector v) {
  const Integers column = __builtin_convertvector(u, Integers);
  const Integers row = __builtin_convertvector(v, Integers);
  const Vector right = u - __builtin_convertvector(column, Vector);
  const Vector down = v - __builtin_convertvector(row, Vector);
  const Integers quad = gather(image.data, row * image.width + column);
  const Vector v00 = __builtin_convertvector(quad & 255, Vector);
  const Vector v10 = __builtin_convertvector((quad >> 8) & 255, Vector);
  const Vector v01 = __builtin_convertvector((quad >> 16) & 255, Vector);
  const Vector v11 = __builtin_convertvector((quad >> 24) & 255, Vector);
  const Vector top = v00 + right * (v10 - v00);
  const Vector bottom = v01 + right * (v11 - v01);
  return top + down * (bottom - top);
}

inline Vector clamped(Vector x, float limit) {
  x = x > 0 ? x : Vector{};
  return x < limit ? x : Vector{} + limit;
}

// Computes weights, products and variance from the grey levels of the samples and of the middle.
void finish_patch(const float* gray, float center, Patch& patch) {
  float total = 0;
  float mean = 0;
  for (int i = 0; i < kPatchSamples; ++i) {
    const float difference = gray[i] > center ? gray[i] - center : center - gray[i];
    patch.weight[i] = kOffsets.spatial[i] * kOffsets.tonal[static_cast<int>(difference + 0.5F)];
    total += patch.weight[i];
    mean += patch.weight[i] * gray[i];
  }
  mean /= total;
  const float scale = 1 / total;
  float variance = 0;
  for (int i = 0; i < kPatchSamples; ++i) {
    patch.weight[i] *= scale;
    const float centred = gray[i] - mean;
    patch.product[i] = patch.weight[i] * centred;
    variance += patch.product[i] * centred;
  }
  patch.variance = variance;
}

void prepare(const GrayImage& image, int x, int y, Patch& patch) {
  float gray[kPatchSamples];
  const std::uint8_t* center = image.data + y * image.step + x;
  const bool is_inside = x >= kPatchRadius && y >= kPatchRadius && x + kPatchRadius < image.width &&
                         y + kPatchRadius < image.height;
  for (int i = 0; i < kPatchSamples; ++i) {
    int sx = static_cast<int>(kOffsets.x[i]);
    int sy = static_cast<int>(kOffsets.y[i]);
    if (!is_inside) {
      sx = (x + sx < 0 ? 0 : x + sx >= image.width ? image.width - 1 : x + sx) - x;
      sy = (y + sy < 0 ? 0 : y + sy >= image.height ? image.height - 1 : y + sy) - y;
    }
    gray[i] = static_cast<float>(center[sy * image.step + sx]);
  }
  finish_patch(gray, static_cast<float>(*center), patch);
}

void prepare_interpolated(const GrayQuads& image, float u, float v, float step, Patch& patch) {
  const float limit_x = static_cast<float>(image.width - 1) - 1e-3F;
  const float limit_y = static_cast<float>(image.height - 1) - 1e-3F;
  float gray[kPatchSamples];
  for (int i = 0; i < kPatchSamples; i += kLanes) {
    const Vector value = between(image, clamped(u + step * load(kOffsets.x + i), limit_x),
                                 clamped(v + step * load(kOffsets.y + i), limit_y));
    std::memcpy(gray + i, &value, sizeof value);
  }
  const Vector center =
      between(image, clamped(Vector{} + u, limit_x), clamped(Vector{} + v, limit_y));
  finish_patch(gray, center[0], patch);
}

float cost(const Patch& patch, const GrayQuads& source, const float* h) {
  const float limit_x = static_cast<float>(source.width - 1) - 1e-3F;
  const float limit_y = static_cast<float>(source.height - 1) - 1e-3F;
  // The middle of the patch must be inside the image. The form !(..) also rejects NaN.
  if (!(h[6] > 0)) return kMaxCost;
  const float scale = 1 / h[6];
  if (!(h[0] * scale >= 0 && h[0] * scale <= limit_x + 1e-3F && h[3] * scale >= 0 &&
        h[3] * scale <= limit_y + 1e-3F))
    return kMaxCost;
  Vector sum{};
  Vector squares{};
  Vector products{};
  Vector nearest = Vector{} + h[6];
  for (int i = 0; i < kPatchSamples; i += kLanes) {
    const Vector dx = load(kOffsets.x + i);
    const Vector dy = load(kOffsets.y + i);
    const Vector z = h[6] + h[7] * dx + h[8] * dy;
    nearest = z < nearest ? z : nearest;
    const Vector inverse = 1 / z;
    const Vector u = (h[0] + h[1] * dx + h[2] * dy) * inverse;
    const Vector v = (h[3] + h[4] * dx + h[5] * dy) * inverse;
    const Vector value = between(source, clamped(u, limit_x), clamped(v, limit_y));
    const Vector weighted = load(patch.weight + i) * value;
    sum += weighted;
    squares += weighted * value;
    products += load(patch.product + i) * value;
  }
  float low = nearest[0];
  for (int i = 1; i < kLanes; ++i) low = nearest[i] < low ? nearest[i] : low;
  if (!(low > 0)) return kMaxCost;
  const float mean = sum_of(sum);
  const float spread = sum_of(squares) - mean * mean;
  const float variance = spread > 0 ? spread : 0;
  const float result =
      1 - sum_of(products) / root_of((patch.variance + kNoise) * (variance + kNoise));
  return result > 0 ? (result < kMaxCost ? result : kMaxCost) : 0;
}

constexpr PatchKernels kKernels{&prepare, &prepare_interpolated, &cost};

}  // namespace

const PatchKernels* TARSIER_PATCH_KERNELS() { return &kKernels; }

}  // namespace tarsier::sfm
