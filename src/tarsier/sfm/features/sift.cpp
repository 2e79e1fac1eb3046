// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/sift.h"

#include "tarsier/core/best_kernels.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/features/sift_kernels.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <numeric>
#include <optional>
#include <tuple>

namespace tarsier::sfm {
namespace {

constexpr int kCellsPerSide = 16;          // cells along the longer side
constexpr int kLayers = 3;                 // scales per octave
constexpr double kSigma = 1.6;             // of the first layer, px of its octave
constexpr double kCameraBlur = 1;          // of the doubled image, from the camera
constexpr int kBorder = 5;                 // px of an octave
constexpr int kMinSide = 16;               // of the last octave
constexpr double kMaxCurvatureRatio = 10;  // max ratio of the principal curvatures
constexpr int kRefinements = 5;
constexpr float kMinPeakRatio = 0.8F;         // min, relative to the highest bin of orientations
constexpr double kWeakContrastFactor = 0.25;  // factor of the contrast, for images of weak texture
constexpr float kMaxComponentRatio = 0.2F;    // relative to a descriptor's length
constexpr float kRootLength = 512;
constexpr int kStripe = 64;  // rows that one thread processes at a time
constexpr int kPointStripe = 256;

FloatPlane plane_of(const cv::Mat1f& image) {
  return {image.ptr<float>(), image.cols, image.rows,
          static_cast<std::ptrdiff_t>(image.step / sizeof(float))};
}

void for_stripes(int count, int stripe, const std::function<void(int, int)>& work) {
  const int stripes = (count + stripe - 1) / stripe;
  cv::parallel_for_(cv::Range(0, stripes), [&](const cv::Range& range) {
    for (int s = range.start; s < range.end; ++s)
      work(s * stripe, std::min(count, (s + 1) * stripe));
  });
}

// Doubles the size: even pixels are those of `gray`, odd ones the means of their neighbours.
cv::Mat1f doubled(const cv::Mat& gray) {
  const int width = gray.cols;
  cv::Mat1f result(2 * gray.rows, 2 * width);
  for_stripes(gray.rows, kStripe, [&](int from, int to) {
    for (int y = from; y < to; ++y) {
      const std::uint8_t* row = gray.ptr(y);
      const std::uint8_t* next = gray.ptr(std::min(y + 1, gray.rows - 1));
      float* even = result[2 * y];
      float* odd = result[2 * y + 1];
      for (int x = 0; x + 1 < width; ++x) {
        even[2 * x] = row[x];
        even[2 * x + 1] = 0.5F * static_cast<float>(row[x] + row[x + 1]);
        odd[2 * x] = 0.5F * static_cast<float>(row[x] + next[x]);
        odd[2 * x + 1] = 0.25F * static_cast<float>(row[x] + row[x + 1] + next[x] + next[x + 1]);
      }
      even[2 * width - 2] = even[2 * width - 1] = row[width - 1];
      odd[2 * width - 2] = odd[2 * width - 1] =
          0.5F * static_cast<float>(row[width - 1] + next[width - 1]);
    }
  });
  return result;
}

// Every second pixel, starting with the first.
cv::Mat1f halved(const cv::Mat1f& image) {
  cv::Mat1f result((image.rows + 1) / 2, (image.cols + 1) / 2);
  for (int y = 0; y < result.rows; ++y) {
    const float* in = image[2 * y];
    float* out = result[y];
    for (int x = 0; x < result.cols; ++x) out[x] = in[2 * x];
  }
  return result;
}

// Blurs by a Gaussian of `sigma`; optionally also returns the difference.
cv::Mat1f blurred(const SiftKernels& kernels, const cv::Mat1f& image, double sigma,
                  cv::Mat1f* difference) {
  const int radius = std::min(kMaxBlurRadius, static_cast<int>(std::ceil(3.5 * sigma)));
  std::array<float, kMaxBlurRadius + 1> taps{};
  double sum = 0;
  for (int k = 0; k <= radius; ++k) {
    const double weight = std::exp(-k * k / (2 * sigma * sigma));
    taps[static_cast<std::size_t>(k)] = static_cast<float>(weight);
    sum += k == 0 ? weight : 2 * weight;
  }
  for (float& tap : taps) tap = static_cast<float>(static_cast<double>(tap) / sum);
  cv::Mat1f result(image.size());
  if (difference != nullptr) difference->create(image.size());
  const FloatPlane plane = plane_of(image);
  for_stripes(image.rows, kStripe, [&](int from, int to) {
    std::vector<float> line(static_cast<std::size_t>(image.cols) + 2 * kBlurPadding);
    kernels.blur(plane, taps.data(), radius, from, to, result.ptr<float>(),
                 difference != nullptr ? difference->ptr<float>() : nullptr,
                 static_cast<std::ptrdiff_t>(result.step / sizeof(float)), line.data());
  });
  return result;
}

struct Extremum {
  float x = 0;  // px of its octave
  float y = 0;
  float sigma = 0;  // px of its octave
  float response = 0;
  int octave = 0;
  int layer = 0;  // index of the blurred image nearest to its scale
};

using Differences = std::array<cv::Mat1f, kLayers + 2>;

// Fits a quadratic to the differences around an extremum and moves to its vertex.
std::optional<Extremum> refined(const Differences& differences, int octave, int layer, int x, int y,
                                double contrast) {
  const cv::Size size = differences[0].size();
  std::array<double, 3> offset{};  // x, y, layer
  std::array<double, 3> slope{};
  double dxx = 0;
  double dyy = 0;
  double dxy = 0;
  double value = 0;
  int step = 0;
  for (; step < kRefinements; ++step) {
    const auto at = [&](int dx, int dy, int dl) {
      return static_cast<double>(differences[static_cast<std::size_t>(layer + dl)](y + dy, x + dx));
    };
    value = at(0, 0, 0);
    slope = {(at(1, 0, 0) - at(-1, 0, 0)) / 2, (at(0, 1, 0) - at(0, -1, 0)) / 2,
             (at(0, 0, 1) - at(0, 0, -1)) / 2};
    dxx = at(1, 0, 0) + at(-1, 0, 0) - 2 * value;
    dyy = at(0, 1, 0) + at(0, -1, 0) - 2 * value;
    const double dll = at(0, 0, 1) + at(0, 0, -1) - 2 * value;
    dxy = (at(1, 1, 0) - at(-1, 1, 0) - at(1, -1, 0) + at(-1, -1, 0)) / 4;
    const double dxl = (at(1, 0, 1) - at(-1, 0, 1) - at(1, 0, -1) + at(-1, 0, -1)) / 4;
    const double dyl = (at(0, 1, 1) - at(0, -1, 1) - at(0, 1, -1) + at(0, -1, -1)) / 4;
    const cv::Matx33d hessian(dxx, dxy, dxl, dxy, dyy, dyl, dxl, dyl, dll);
    cv::Vec3d move;
    if (!cv::solve(hessian, cv::Vec3d(-slope[0], -slope[1], -slope[2]), move, cv::DECOMP_LU))
      return std::nullopt;
    offset = {move[0], move[1], move[2]};
    const double farthest =
        std::max({std::abs(offset[0]), std::abs(offset[1]), std::abs(offset[2])});
    if (farthest < 0.5) break;
    if (!(farthest < 1e6)) return std::nullopt;
    x += cvRound(offset[0]);
    y += cvRound(offset[1]);
    layer += cvRound(offset[2]);
    if (layer < 1 || layer > kLayers || x < kBorder || x >= size.width - kBorder || y < kBorder ||
        y >= size.height - kBorder)
      return std::nullopt;
  }
  if (step == kRefinements) return std::nullopt;
  const double peak =
      value + (slope[0] * offset[0] + slope[1] * offset[1] + slope[2] * offset[2]) / 2;
  if (std::abs(peak) * kLayers < contrast * 255) return std::nullopt;
  const double trace = dxx + dyy;
  const double determinant = dxx * dyy - dxy * dxy;
  if (determinant <= 0 || trace * trace * kMaxCurvatureRatio >=
                              (kMaxCurvatureRatio + 1) * (kMaxCurvatureRatio + 1) * determinant)
    return std::nullopt;
  Extremum extremum;
  extremum.x = static_cast<float>(x + offset[0]);
  extremum.y = static_cast<float>(y + offset[1]);
  extremum.sigma = static_cast<float>(kSigma * std::exp2((layer + offset[2]) / kLayers));
  extremum.response = static_cast<float>(std::abs(peak));
  extremum.octave = octave;
  extremum.layer = std::clamp(static_cast<int>(std::lround(layer + offset[2])), 1, kLayers);
  return extremum;
}

void add_extrema(const SiftKernels& kernels, const Differences& differences, int octave,
                 double contrast, std::vector<Extremum>& all) {
  const cv::Size size = differences[0].size();
  const int rows = size.height - 2 * kBorder;
  if (rows <= 0 || size.width <= 2 * kBorder) return;
  const auto threshold = static_cast<float>(0.5 * contrast / kLayers * 255);
  std::vector<std::vector<Extremum>> of_stripes(
      static_cast<std::size_t>((rows + kStripe - 1) / kStripe));
  for_stripes(rows, kStripe, [&](int from, int to) {
    std::vector<int> found(static_cast<std::size_t>(size.width));
    auto& extrema = of_stripes[static_cast<std::size_t>(from / kStripe)];
    for (int layer = 1; layer <= kLayers; ++layer) {
      const auto at = static_cast<std::size_t>(layer);
      const FloatPlane below = plane_of(differences[at - 1]);
      const FloatPlane middle = plane_of(differences[at]);
      const FloatPlane above = plane_of(differences[at + 1]);
      for (int y = from + kBorder; y < to + kBorder; ++y) {
        const int count =
            kernels.extrema(below, middle, above, y, kBorder, threshold, found.data());
        for (int k = 0; k < count; ++k) {
          if (const auto extremum = refined(differences, octave, layer,
                                            found[static_cast<std::size_t>(k)], y, contrast))
            extrema.push_back(*extremum);
        }
      }
    }
  });
  for (const auto& extrema : of_stripes) all.insert(all.end(), extrema.begin(), extrema.end());
}

// Radians, of the peaks of a histogram, after smoothing.
std::vector<float> peaks_of(const float (&histogram)[kOrientations]) {
  std::array<float, kOrientations> smooth{};
  const auto at = [&](int k) { return histogram[(k + kOrientations) % kOrientations]; };
  for (int k = 0; k < kOrientations; ++k)
    smooth[static_cast<std::size_t>(k)] = (at(k - 2) + at(k + 2)) * (1 / 16.0F) +
                                          (at(k - 1) + at(k + 1)) * (4 / 16.0F) +
                                          at(k) * (6 / 16.0F);
  const float highest = *std::max_element(smooth.begin(), smooth.end());
  std::vector<float> peaks;
  for (int k = 0; k < kOrientations; ++k) {
    const float left = smooth[static_cast<std::size_t>((k + kOrientations - 1) % kOrientations)];
    const float value = smooth[static_cast<std::size_t>(k)];
    const float right = smooth[static_cast<std::size_t>((k + 1) % kOrientations)];
    if (value <= left || value <= right || value < kMinPeakRatio * highest) continue;
    const float bin = static_cast<float>(k) + 0.5F * (left - right) / (left - 2 * value + right);
    peaks.push_back(bin * (2 * std::numbers::pi_v<float> / kOrientations));
  }
  return peaks;
}

// Clips, and takes square roots of the shares: their distances are Hellinger distances.
void write_root_sift(const float (&descriptor)[kDescriptorLength], std::uint8_t* out) {
  float square = 0;
  for (const float value : descriptor) square += value * value;
  const float max_value = kMaxComponentRatio * std::sqrt(square);
  float sum = 1e-6F;
  for (const float value : descriptor) sum += std::min(value, max_value);
  for (int k = 0; k < kDescriptorLength; ++k)
    out[k] = cv::saturate_cast<std::uint8_t>(kRootLength *
                                             std::sqrt(std::min(descriptor[k], max_value) / sum));
}

// The octaves of an image: extrema, and the blurred images 1..kLayers for descriptors.
struct ScaleSpace {
  std::vector<std::array<cv::Mat1f, kLayers + 1>> octaves;
  std::vector<Extremum> extrema;
};

ScaleSpace scale_space(const SiftKernels& kernels, const cv::Mat& gray, double contrast) {
  ScaleSpace space;
  cv::Mat1f base = blurred(kernels, doubled(gray),
                           std::sqrt(kSigma * kSigma - kCameraBlur * kCameraBlur), nullptr);
  while (std::min(base.cols, base.rows) >= kMinSide) {
    std::array<cv::Mat1f, kLayers + 1> images;
    Differences differences;
    cv::Mat1f last = base;
    for (int layer = 1; layer <= kLayers + 2; ++layer) {
      const double before = kSigma * std::exp2((layer - 1.0) / kLayers);
      const double after = kSigma * std::exp2(static_cast<double>(layer) / kLayers);
      last = blurred(kernels, last, std::sqrt(after * after - before * before),
                     &differences[static_cast<std::size_t>(layer - 1)]);
      if (layer <= kLayers) images[static_cast<std::size_t>(layer)] = last;
    }
    add_extrema(kernels, differences, static_cast<int>(space.octaves.size()), contrast,
                space.extrema);
    base = halved(images[kLayers]);
    space.octaves.push_back(std::move(images));
  }
  return space;
}

// All with the contrast, then others up to `min_count`.
std::vector<int> add_weak_extrema(const std::vector<int>& order,
                                  const std::vector<float>& responses, const SiftOptions& options) {
  std::vector<int> result;
  std::vector<int> weak;
  for (const int i : order) {
    const auto peak = static_cast<double>(responses[static_cast<std::size_t>(i)]);
    (peak * kLayers >= options.contrast * 255 ? result : weak).push_back(i);
  }
  const auto min_count = static_cast<std::size_t>(options.min_count);
  const std::size_t free_count = min_count > result.size() ? min_count - result.size() : 0;
  result.insert(result.end(), weak.begin(),
                weak.begin() + static_cast<std::ptrdiff_t>(std::min(free_count, weak.size())));
  return result;
}

}  // namespace

const SiftKernels& sift_kernels() { return best_kernels(sift_baseline, sift_avx2, sift_avx512); }

std::vector<int> select_by_cells(const std::vector<cv::Point2f>& points,
                                 const std::vector<float>& responses, cv::Size size,
                                 int max_count) {
  const double cell = std::max(size.width, size.height) / static_cast<double>(kCellsPerSide);
  const int across = static_cast<int>(size.width / cell) + 1;
  const int down = static_cast<int>(size.height / cell) + 1;
  std::vector<std::vector<int>> cells(static_cast<std::size_t>(across * down));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const int x = std::clamp(static_cast<int>(points[i].x / cell), 0, across - 1);
    const int y = std::clamp(static_cast<int>(points[i].y / cell), 0, down - 1);
    cells[static_cast<std::size_t>(y * across + x)].push_back(static_cast<int>(i));
  }
  const auto stronger = [&](int a, int b) {
    const float p = responses[static_cast<std::size_t>(a)];
    const float q = responses[static_cast<std::size_t>(b)];
    return p != q ? p > q : a < b;
  };
  for (auto& members : cells) std::sort(members.begin(), members.end(), stronger);
  std::vector<int> chosen;
  for (std::size_t rank = 0; static_cast<int>(chosen.size()) < max_count; ++rank) {
    bool any = false;
    for (const auto& members : cells) {
      if (rank >= members.size()) continue;
      any = true;
      if (static_cast<int>(chosen.size()) < max_count) chosen.push_back(members[rank]);
    }
    if (!any) break;
  }
  return chosen;
}

SiftFeatures find_sift(const cv::Mat& gray, const SiftOptions& options) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1, "an image of type {}", gray.type());
  options.check();
  SiftFeatures features;
  if (gray.cols < kMinSide / 2 || gray.rows < kMinSide / 2) return features;
  const SiftKernels& kernels = sift_kernels();

  ScaleSpace space = scale_space(kernels, gray, options.contrast);
  const auto strong = static_cast<int>(space.extrema.size());
  if (strong < std::min(options.min_count, options.max_count))
    space = scale_space(kernels, gray, kWeakContrastFactor * options.contrast);
  const std::vector<Extremum>& extrema = space.extrema;

  // The strongest in each region.
  std::vector<cv::Point2f> positions;
  std::vector<float> responses;
  for (const Extremum& e : extrema) {
    const float scale = std::ldexp(0.5F, e.octave);
    positions.emplace_back(e.x * scale, e.y * scale);
    responses.push_back(e.response);
  }
  std::vector<int> order = select_by_cells(positions, responses, gray.size(), options.max_count);
  if (strong < static_cast<int>(extrema.size()))
    order = add_weak_extrema(order, responses, options);

  std::vector<std::vector<float>> angles(order.size());
  const auto image_of = [&](const Extremum& e) {
    return plane_of(
        space.octaves[static_cast<std::size_t>(e.octave)][static_cast<std::size_t>(e.layer)]);
  };
  for_stripes(static_cast<int>(order.size()), kPointStripe, [&](int from, int to) {
    for (int k = from; k < to; ++k) {
      const Extremum& e = extrema[static_cast<std::size_t>(order[static_cast<std::size_t>(k)])];
      float histogram[kOrientations];
      kernels.orientations(image_of(e), e.x, e.y, e.sigma, histogram);
      angles[static_cast<std::size_t>(k)] = peaks_of(histogram);
    }
  });

  struct OrientedExtremum {
    int extremum;
    float angle;
  };
  std::vector<OrientedExtremum> chosen;
  for (std::size_t k = 0; k < order.size(); ++k)
    for (const float angle : angles[k])
      if (static_cast<int>(chosen.size()) < options.max_count) chosen.push_back({order[k], angle});
  const auto key = [&](const OrientedExtremum& c) {
    const auto i = static_cast<std::size_t>(c.extremum);
    return std::tuple(positions[i].y, positions[i].x, extrema[i].sigma, c.angle);
  };
  std::sort(chosen.begin(), chosen.end(),
            [&](const OrientedExtremum& a, const OrientedExtremum& b) { return key(a) < key(b); });

  features.descriptors.create(static_cast<int>(chosen.size()), kDescriptorLength, CV_8UC1);
  for_stripes(static_cast<int>(chosen.size()), kPointStripe, [&](int from, int to) {
    for (int k = from; k < to; ++k) {
      const OrientedExtremum& c = chosen[static_cast<std::size_t>(k)];
      const Extremum& e = extrema[static_cast<std::size_t>(c.extremum)];
      float descriptor[kDescriptorLength];
      kernels.describe(image_of(e), e.x, e.y, e.sigma, std::cos(c.angle), std::sin(c.angle),
                       descriptor);
      write_root_sift(descriptor, features.descriptors.ptr(k));
    }
  });
  for (const OrientedExtremum& c : chosen) {
    const auto i = static_cast<std::size_t>(c.extremum);
    features.points.push_back(positions[i]);
    features.sizes.push_back(2 * extrema[i].sigma * std::ldexp(0.5F, extrema[i].octave));
  }
  return features;
}

}  // namespace tarsier::sfm
