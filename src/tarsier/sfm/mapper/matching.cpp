// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/matching.h"

#include "tarsier/core/require.h"
#include "tarsier/sfm/mapper/nearest.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace tarsier::sfm {
namespace {

// Rows of bytes whose squared distances are those of the descriptors: bits as bytes 0 and 1.
std::vector<std::uint8_t> bytes_of(const cv::Mat& descriptors, FeatureKind kind) {
  std::vector<std::uint8_t> bytes;
  const bool bits = kind != FeatureKind::kSift;
  bytes.reserve(descriptors.total() * (bits ? 8 : 1));
  for (int r = 0; r < descriptors.rows; ++r) {
    const std::uint8_t* in = descriptors.ptr(r);
    if (!bits) bytes.insert(bytes.end(), in, in + descriptors.cols);
    for (int k = 0; bits && k < 8 * descriptors.cols; ++k)
      bytes.push_back(in[k / 8] >> (k % 8) & 1);
  }
  return bytes;
}

int product(const std::uint8_t* a, const std::uint8_t* b, int count) {
  int sum = 0;
  for (int k = 0; k < count; ++k) sum += a[k] * b[k];
  return sum;
}

double norm_of(const cv::Mat& descriptors, int row) {
  const std::uint8_t* a = descriptors.ptr(row);
  return std::sqrt(std::max(1, product(a, a, descriptors.cols)));
}

}  // namespace

std::vector<double> norms_of(const cv::Mat& descriptors, FeatureKind kind) {
  std::vector<double> norms(static_cast<std::size_t>(descriptors.rows), 1);
  if (kind == FeatureKind::kSift)
    for (int row = 0; row < descriptors.rows; ++row)
      norms[static_cast<std::size_t>(row)] = norm_of(descriptors, row);
  return norms;
}

double similarity(const cv::Mat& first, int row, const cv::Mat& second, int other,
                  FeatureKind kind) {
  const double norms =
      kind == FeatureKind::kSift ? norm_of(first, row) * norm_of(second, other) : 1;
  return similarity(first, row, second, other, kind, norms);
}

double similarity(const cv::Mat& first, int row, const cv::Mat& second, int other, FeatureKind kind,
                  double norms) {
  const std::uint8_t* a = first.ptr(row);
  const std::uint8_t* b = second.ptr(other);
  if (kind == FeatureKind::kSift) return product(a, b, first.cols) / norms;
  int differ = 0;
  for (int k = 0; k < first.cols; ++k)
    differ += std::popcount(static_cast<std::uint8_t>(a[k] ^ b[k]));
  return 1 - 2.0 * differ / (8.0 * first.cols);
}

std::vector<Match> match_features(const cv::Mat& first, const cv::Mat& second, FeatureKind kind,
                                  const MatchOptions& options, std::vector<float>* ratios) {
  options.check();
  if (ratios != nullptr) ratios->clear();
  if (first.empty() || second.empty()) return {};
  TARSIER_REQUIRE(first.type() == CV_8UC1 && second.type() == CV_8UC1 && first.cols == second.cols,
                  "descriptors of {} and {} columns", first.cols, second.cols);
  const std::vector<std::uint8_t> a = bytes_of(first, kind);
  const std::vector<std::uint8_t> b = bytes_of(second, kind);
  const int depth = first.cols * (kind == FeatureKind::kSift ? 1 : 8);
  std::vector<Nearest> of_a(static_cast<std::size_t>(first.rows));
  std::vector<Nearest> of_b(static_cast<std::size_t>(second.rows));
  find_nearest({a.data(), first.rows, depth}, {b.data(), second.rows, depth}, of_a.data(),
               of_b.data());

  // The distance of bits is their count, that of vectors the root of the squares.
  const double ratio = options.ratio * (kind == FeatureKind::kSift ? options.ratio : 1);
  const auto passes = [&](const Nearest& nearest) {
    return static_cast<double>(nearest.best) < ratio * static_cast<double>(nearest.second);
  };
  std::vector<Match> matches;
  for (int i = 0; i < first.rows; ++i) {
    const Nearest& nearest = of_a[static_cast<std::size_t>(i)];
    if (nearest.index < 0 || !passes(nearest)) continue;
    const Nearest& back = of_b[static_cast<std::size_t>(nearest.index)];
    if (back.index != i) continue;
    matches.push_back({i, nearest.index});
    if (ratios != nullptr)
      ratios->push_back(static_cast<float>(nearest.best) / static_cast<float>(nearest.second));
  }
  return matches;
}

}  // namespace tarsier::sfm
