// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/features.h"

#include "tarsier/core/image.h"
#include "tarsier/core/rng.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

namespace tarsier::planar::image_targets {
namespace {

constexpr double kSpacing = 1.2;  // px of the level between two samples of a patch

Level make_level(const cv::Mat& raw, cv::Size full) {
  Level level;
  level.width = raw.cols;
  level.height = raw.rows;
  level.step_x = static_cast<double>(full.width) / raw.cols;
  level.step_y = static_cast<double>(full.height) / raw.rows;
  cv::Mat smooth;
  cv::GaussianBlur(raw, smooth, cv::Size(5, 5), 1.1, 1.1, cv::BORDER_REPLICATE);
  cv::copyMakeBorder(smooth, level.padded, Level::kMargin, Level::kMargin, Level::kMargin,
                     Level::kMargin, cv::BORDER_REPLICATE);
  return level;
}

struct Candidate {
  float x = 0;
  float y = 0;
  float response = 0;
  float rank = 0;
};

// Local 3x3 maxima of the determinant on one level, except in the border of 4 px.
void find_maxima(const Level& level, double min_response, std::vector<Candidate>& out) {
  constexpr int kEdge = 4;
  const int n = level.width - 2 * (kEdge - 1);
  if (n < 3 || level.height < 2 * kEdge + 3) return;
  const Kernels& kernel = kernels();
  std::vector<int> buffer(static_cast<std::size_t>(n) * 3);
  int* rows[3] = {buffer.data(), buffer.data() + n,
                  buffer.data() + 2 * static_cast<std::size_t>(n)};
  std::vector<std::uint8_t> is_maximum(static_cast<std::size_t>(n) + 8);
  const auto fill = [&](int y, int* row) {
    const std::uint8_t* source[5];
    for (int k = 0; k < 5; ++k) source[k] = level.row(y + k - 2) + kEdge - 1;
    kernel.hessian_row(source, n, row);
  };
  fill(kEdge - 1, rows[0]);
  fill(kEdge, rows[1]);
  const int bound = static_cast<int>(std::min(16 * min_response * min_response, 1e9));
  for (int y = kEdge; y < level.height - kEdge; ++y) {
    fill(y + 1, rows[2]);
    kernel.maxima(rows[0], rows[1], rows[2], n, bound, is_maximum.data());
    for (int x = 1; x + 1 < n; ++x) {
      if (is_maximum[static_cast<std::size_t>(x)] == 0) {
        // Tests eight pixels at a time; mostly there is none.
        std::uint64_t eight = 1;
        while (x + 8 < n &&
               (std::memcpy(&eight, &is_maximum[static_cast<std::size_t>(x)], 8), eight == 0))
          x += 8;
        if (x + 1 >= n || is_maximum[static_cast<std::size_t>(x)] == 0) continue;
      }
      const int v = rows[1][x];
      // Maximum of the parabolas through the neighbours.
      const auto offset = [](double a, double b, double c) {
        const double bend = a - 2 * b + c;
        return bend < 0 ? std::clamp(0.5 * (a - c) / bend, -0.5, 0.5) : 0.0;
      };
      const double sub_x = offset(rows[1][x - 1], v, rows[1][x + 1]);
      const double sub_y = offset(rows[0][x], v, rows[2][x]);
      out.push_back({static_cast<float>(x + kEdge - 1 + sub_x), static_cast<float>(y + sub_y),
                     std::sqrt(static_cast<float>(v)) / 4, 0});
    }
    std::rotate(rows, rows + 1, rows + 3);
  }
}

void keep_spread(const Level& level, std::size_t max_count, std::vector<Candidate>& candidates) {
  constexpr int kCell = 40;
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    if (a.response != b.response) return a.response > b.response;
    return a.y != b.y ? a.y < b.y : a.x < b.x;
  });
  if (candidates.size() <= max_count) return;
  const int columns = level.width / kCell + 1;
  std::vector<float> share(static_cast<std::size_t>(columns * (level.height / kCell + 1)), 1);
  for (Candidate& c : candidates) {
    float& part = share[static_cast<std::size_t>(static_cast<int>(c.y) / kCell * columns +
                                                 static_cast<int>(c.x) / kCell)];
    c.rank = c.response * part;
    part *= 0.85F;
  }
  const auto better = [](const Candidate& a, const Candidate& b) {
    if (a.rank != b.rank) return a.rank > b.rank;
    return a.y != b.y ? a.y < b.y : a.x < b.x;
  };
  const auto end = candidates.begin() + static_cast<std::ptrdiff_t>(max_count);
  std::nth_element(candidates.begin(), end, candidates.end(), better);
  std::sort(candidates.begin(), end, better);
  candidates.resize(max_count);
}

// The strongest gradient orientations around a point, at most two.
int find_directions(const Level& level, const Candidate& c, bool second, float out[2]) {
  float histogram[kDirections] = {};
  const int cx = static_cast<int>(std::lround(c.x));
  const int cy = static_cast<int>(std::lround(c.y));
  kernels().directions(level.row(cy) + cx, static_cast<int>(level.padded.step), histogram);
  float smooth[kDirections];
  for (int pass = 0; pass < 2; ++pass) {
    for (int i = 0; i < kDirections; ++i)
      smooth[i] = (histogram[(i + kDirections - 1) % kDirections] + 2 * histogram[i] +
                   histogram[(i + 1) % kDirections]) /
                  4;
    std::copy(smooth, smooth + kDirections, histogram);
  }
  int found = 0;
  float heights[2] = {};
  const float peak = *std::max_element(histogram, histogram + kDirections);
  for (int i = 0; i < kDirections; ++i) {
    const float a = histogram[(i + kDirections - 1) % kDirections];
    const float b = histogram[i];
    const float d = histogram[(i + 1) % kDirections];
    if (b < 0.8F * peak || b <= a || b < d) continue;
    const float bin = static_cast<float>(i) + 0.5F + 0.5F * (a - d) / (a - 2 * b + d);
    const float angle = bin * (6.28318531F / kDirections) - 3.14159274F;
    if (found == 2) {
      if (b <= heights[1]) continue;
      found = 1;
    }
    out[found] = angle;
    heights[found] = b;
    ++found;
    if (found == 2 && heights[1] > heights[0]) {
      std::swap(heights[0], heights[1]);
      std::swap(out[0], out[1]);
    }
  }
  return second ? found : std::min(found, 1);
}

// Pairs of descriptor values whose order gives one bit of the sketch.
const std::array<std::array<std::uint8_t, 2>, 64 * kSketchWords>& sketch_pairs() {
  static const auto table = [] {
    std::array<std::array<std::uint8_t, 2>, 64 * kSketchWords> pairs{};
    Rng rng(20);
    for (auto& pair : pairs) {
      do {
        pair[0] = static_cast<std::uint8_t>(rng.integer(0, kDescriptorSize - 1));
        pair[1] = static_cast<std::uint8_t>(rng.integer(0, kDescriptorSize - 1));
      } while (pair[0] == pair[1]);
    }
    return pairs;
  }();
  return table;
}

void describe(const Level& level, const Candidate& c, float angle, Descriptor& out) {
  const Kernels& kernel = kernels();
  const double dx = kSpacing * std::cos(angle);
  const double dy = kSpacing * std::sin(angle);
  constexpr double kHalf = (kSampleSide - 1) / 2.0;
  const auto fixed = [](double v) { return static_cast<int>(std::lround(v * 65536)); };
  alignas(64) float samples[kSampleSide * kSampleSide];
  kernel.sample(level.padded.ptr<std::uint8_t>(), static_cast<int>(level.padded.step),
                fixed(c.x + Level::kMargin - kHalf * (dx - dy)),
                fixed(c.y + Level::kMargin - kHalf * (dx + dy)), fixed(dx), fixed(dy), samples);
  float pooled[kDescriptorSize];
  kernel.pool(samples, pooled);
  const float sum = std::accumulate(pooled, pooled + kDescriptorSize, 1e-6F);
  for (std::size_t i = 0; i < kDescriptorSize; ++i) {
    const float root = 256 * std::sqrt(pooled[i] / sum);
    out.values[i] = static_cast<std::uint8_t>(std::min(255.0F, root + 0.5F));
  }
  const auto& pairs = sketch_pairs();
  for (std::size_t w = 0; w < kSketchWords; ++w) {
    std::uint64_t bits = 0;
    for (std::size_t b = 0; b < 64; ++b) {
      const auto& pair = pairs[w * 64 + b];
      bits |= static_cast<std::uint64_t>(pooled[pair[0]] > pooled[pair[1]]) << b;
    }
    out.sketch[w] = bits;
  }
}

}  // namespace

Pyramid make_pyramid(const cv::Mat& gray, bool half_steps, int min_side, int max_levels) {
  require_gray(gray);
  TARSIER_REQUIRE(gray.cols >= 8 && gray.rows >= 8, "{}x{}: at least 8x8", gray.cols, gray.rows);
  Pyramid pyramid;
  std::vector<cv::Mat> raw;
  const double root = std::sqrt(0.5);
  for (int k = 0; k < max_levels; ++k) {
    cv::Mat level;
    if (k == 0) {
      level = gray;
    } else if (k == 1) {
      if (half_steps)
        cv::resize(gray, level,
                   cv::Size(static_cast<int>(std::lround(gray.cols * root)),
                            static_cast<int>(std::lround(gray.rows * root))),
                   0, 0, cv::INTER_LINEAR);
    } else if (const cv::Mat& from = raw[static_cast<std::size_t>(k) - 2]; !from.empty()) {
      if (std::min(from.cols, from.rows) / 2 >= 4)
        cv::resize(from, level, cv::Size(from.cols / 2, from.rows / 2), 0, 0, cv::INTER_AREA);
    }
    const bool wanted = k % 2 == 0 || half_steps;
    if (wanted && k > 0 && std::min(level.cols, level.rows) < min_side) break;
    raw.push_back(level);
    pyramid.levels.push_back(wanted ? make_level(level, gray.size()) : Level{});
  }
  return pyramid;
}

FeatureSet find_features(const Pyramid& pyramid, const FeatureOptions& options) {
  options.check();
  FeatureSet set;
  // The finest level has the most pixels and the most noise: quotas are proportional to the square
  // root of the area.
  double total = 0;
  for (const Level& level : pyramid.levels) total += std::sqrt(level.width * 1.0 * level.height);
  for (std::size_t k = 0; k < pyramid.levels.size(); ++k) {
    const Level& level = pyramid.levels[k];
    if (level.width == 0) continue;
    std::vector<Candidate> candidates;
    find_maxima(level, options.contrast, candidates);
    const double share = std::sqrt(level.width * 1.0 * level.height) / total;
    keep_spread(level, static_cast<std::size_t>(std::lround(options.max_features * share)),
                candidates);
    for (const Candidate& c : candidates) {
      float angles[2];
      const int found = find_directions(level, c, options.second_directions, angles);
      for (int i = 0; i < found; ++i) {
        Feature feature;
        feature.at = level.to_image({c.x, c.y});
        feature.scale = static_cast<float>(std::sqrt(level.step_x * level.step_y));
        feature.angle = angles[i];
        feature.response = c.response;
        feature.level = static_cast<int>(k);
        set.features.push_back(feature);
        describe(level, c, angles[i], set.descriptors.emplace_back());
      }
    }
  }
  return set;
}

}  // namespace tarsier::planar::image_targets
