// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/matching.h"

#include "tarsier/core/require.h"
#include "tarsier/sfm/features/nearest.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <tuple>

namespace tarsier::sfm {
namespace {

// Rows of bytes whose squared distances equal those of the descriptors: bits become bytes 0 and 1.
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

// The distance of bits is their count; that of vectors is the root of the squared distance.
bool passes(const Nearest& nearest, FeatureKind kind, const MatchOptions& options) {
  const double ratio = options.ratio * (kind == FeatureKind::kSift ? options.ratio : 1);
  return static_cast<double>(nearest.best) < ratio * static_cast<double>(nearest.second);
}

float ratio_of(const Nearest& nearest) {
  return static_cast<float>(nearest.best) / static_cast<float>(nearest.second);
}

// For each descriptor: the first point at the position that it describes.
std::vector<std::int32_t> first_points_at_positions(const Features& features) {
  const auto points = static_cast<std::int32_t>(features.points.size());
  std::vector<std::int32_t> first_points;
  first_points.reserve(static_cast<std::size_t>(features.descriptors.rows));
  for (std::int32_t i = 0; i < points; ++i) {
    const auto k = static_cast<std::size_t>(i);
    // Points at one position are adjacent.
    const bool same = i > 0 && features.points[k] == features.points[k - 1];
    first_points.push_back(same ? first_points.back() : i);
  }
  for (const std::int32_t owner : features.owners)
    first_points.push_back(first_points[static_cast<std::size_t>(owner)]);
  TARSIER_REQUIRE(static_cast<int>(first_points.size()) == features.descriptors.rows,
                  "{} descriptors for {} points", features.descriptors.rows, first_points.size());
  return first_points;
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
                  "descriptors with {} and {} columns", first.cols, second.cols);
  const std::vector<std::uint8_t> a = bytes_of(first, kind);
  const std::vector<std::uint8_t> b = bytes_of(second, kind);
  const int depth = first.cols * (kind == FeatureKind::kSift ? 1 : 8);
  std::vector<Nearest> of_a(static_cast<std::size_t>(first.rows));
  std::vector<Nearest> of_b(static_cast<std::size_t>(second.rows));
  find_nearest({a.data(), first.rows, depth}, {b.data(), second.rows, depth}, of_a.data(),
               of_b.data());

  std::vector<Match> matches;
  for (int i = 0; i < first.rows; ++i) {
    const Nearest& nearest = of_a[static_cast<std::size_t>(i)];
    if (nearest.index < 0 || !passes(nearest, kind, options)) continue;
    const Nearest& back = of_b[static_cast<std::size_t>(nearest.index)];
    if (back.index != i) continue;
    matches.push_back({i, nearest.index});
    if (ratios != nullptr) ratios->push_back(ratio_of(nearest));
  }
  return matches;
}

std::vector<Match> match_features(const Features& first, const Features& second, FeatureKind kind,
                                  const MatchOptions& options, std::vector<float>* ratios) {
  if (first.owners.empty() && second.owners.empty())
    return match_features(first.descriptors, second.descriptors, kind, options, ratios);
  options.check();
  if (ratios != nullptr) ratios->clear();
  if (first.descriptors.empty() || second.descriptors.empty()) return {};
  TARSIER_REQUIRE(first.descriptors.type() == CV_8UC1 && second.descriptors.type() == CV_8UC1 &&
                      first.descriptors.cols == second.descriptors.cols,
                  "descriptors with {} and {} columns", first.descriptors.cols,
                  second.descriptors.cols);
  const std::vector<std::int32_t> first_points_a = first_points_at_positions(first);
  const std::vector<std::int32_t> first_points_b = first_points_at_positions(second);
  const std::vector<std::uint8_t> a = bytes_of(first.descriptors, kind);
  const std::vector<std::uint8_t> b = bytes_of(second.descriptors, kind);
  const int depth = first.descriptors.cols * (kind == FeatureKind::kSift ? 1 : 8);
  std::vector<Nearest> of_a(first_points_a.size());
  std::vector<Nearest> of_b(first_points_b.size());
  find_nearest({a.data(), first.descriptors.rows, depth, first_points_a.data()},
               {b.data(), second.descriptors.rows, depth, first_points_b.data()}, of_a.data(),
               of_b.data());

  // Several descriptors may match the same two positions: the nearest match counts. A position that
  // matches several others keeps the nearest one.
  struct Candidate {
    std::int32_t distance;
    Match match;
    float ratio;
    bool operator<(const Candidate& other) const {
      return std::tie(distance, match.first, match.second) <
             std::tie(other.distance, other.match.first, other.match.second);
    }
  };
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    const Nearest& nearest = of_a[i];
    if (nearest.index < 0 || !passes(nearest, kind, options)) continue;
    const auto j = static_cast<std::size_t>(nearest.index);
    const Nearest& back = of_b[j];
    if (back.index < 0 || first_points_a[static_cast<std::size_t>(back.index)] != first_points_a[i])
      continue;
    candidates.push_back({nearest.best, {first_points_a[i], first_points_b[j]}, ratio_of(nearest)});
  }
  std::sort(candidates.begin(), candidates.end());
  std::vector<char> is_matched_a(first.points.size(), 0);
  std::vector<char> is_matched_b(second.points.size(), 0);
  std::vector<Candidate> accepted;
  for (const Candidate& candidate : candidates) {
    char& own = is_matched_a[static_cast<std::size_t>(candidate.match.first)];
    char& other = is_matched_b[static_cast<std::size_t>(candidate.match.second)];
    if (own == 0 && other == 0) accepted.push_back(candidate);
    own = other = 1;
  }
  std::sort(accepted.begin(), accepted.end(),
            [](const Candidate& x, const Candidate& y) { return x.match.first < y.match.first; });
  std::vector<Match> matches;
  for (const Candidate& candidate : accepted) {
    matches.push_back(candidate.match);
    if (ratios != nullptr) ratios->push_back(candidate.ratio);
  }
  return matches;
}

}  // namespace tarsier::sfm
