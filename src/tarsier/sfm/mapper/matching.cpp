// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/matching.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/gemm.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace tarsier::sfm {
namespace {

constexpr int kBlock = 128;  // rows at a time: their scores against a panel stay in the cache
constexpr float kNever = -std::numeric_limits<float>::infinity();

// Rows of numbers whose scalar products order neighbours as the descriptors' distances do.
struct Vectors {
  int rows = 0;
  int depth = 0;
  std::vector<float> values;
  std::vector<float> squares;  // of each row's length
};

Vectors vectors_of(const cv::Mat& descriptors, FeatureKind kind) {
  Vectors v;
  v.rows = descriptors.rows;
  const bool bits = kind != FeatureKind::kSift;
  v.depth = descriptors.cols * (bits ? 8 : 1);
  v.values.resize(static_cast<std::size_t>(v.rows) * static_cast<std::size_t>(v.depth));
  v.squares.assign(static_cast<std::size_t>(v.rows), 0);
  for (int r = 0; r < v.rows; ++r) {
    const std::uint8_t* in = descriptors.ptr(r);
    float* out = v.values.data() + static_cast<std::ptrdiff_t>(r) * v.depth;
    float sum = 0;
    for (int k = 0; k < v.depth; ++k) {
      out[k] = bits ? ((in[k / 8] >> (k % 8) & 1) != 0 ? 1.0F : -1.0F) : static_cast<float>(in[k]);
      sum += out[k] * out[k];
    }
    v.squares[static_cast<std::size_t>(r)] = sum;
  }
  return v;
}

// The two nearest of a row: least squared distances, and which is the nearest.
struct Nearest {
  float best = -kNever;
  float second = -kNever;
  int index = -1;

  void offer(float distance, int candidate) {
    if (distance < best) {
      second = best;
      best = distance;
      index = candidate;
    } else if (distance < second) {
      second = distance;
    }
  }
};

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
                                  const MatchOptions& options) {
  options.check();
  if (first.empty() || second.empty()) return {};
  TARSIER_REQUIRE(first.type() == CV_8UC1 && second.type() == CV_8UC1 && first.cols == second.cols,
                  "descriptors of {} and {} columns", first.cols, second.cols);
  const Vectors a = vectors_of(first, kind);
  const Vectors b = vectors_of(second, kind);
  const int panels = (b.rows + linalg::kPanel - 1) / linalg::kPanel;
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(panels) * linalg::kPanel;
  std::vector<float> columns(static_cast<std::size_t>(stride) * static_cast<std::size_t>(b.depth),
                             0.0F);
  for (int r = 0; r < b.rows; ++r) {
    const float* in = b.values.data() + static_cast<std::ptrdiff_t>(r) * b.depth;
    for (int k = 0; k < b.depth; ++k) columns[static_cast<std::size_t>(k * stride + r)] = in[k];
  }

  std::vector<Nearest> of_a(static_cast<std::size_t>(a.rows));
  std::vector<Nearest> of_b(static_cast<std::size_t>(b.rows));
  // The second distances of b once more, in a row: a whole panel is compared with them at once, and
  // hardly any has something better.
  std::vector<float> seconds(static_cast<std::size_t>(stride), -kNever);
  std::vector<float> products(static_cast<std::size_t>(kBlock) * linalg::kPanel);
  const linalg::GemmKernels& kernels = linalg::gemm_kernels();
  for (int start = 0; start < a.rows; start += kBlock) {
    const int rows = std::min(kBlock, a.rows - start);
    for (int panel = 0; panel < panels; ++panel) {
      kernels.panel(rows, a.depth, a.values.data() + static_cast<std::ptrdiff_t>(start) * a.depth,
                    a.depth, 1,
                    columns.data() + static_cast<std::ptrdiff_t>(panel) * linalg::kPanel, stride,
                    products.data());
      const int from = panel * linalg::kPanel;
      const int count = std::min(linalg::kPanel, b.rows - from);
      const float* squares_b = b.squares.data() + from;
      for (int r = 0; r < rows; ++r) {
        float* row = products.data() + static_cast<std::ptrdiff_t>(r) * linalg::kPanel;
        const float square_a = a.squares[static_cast<std::size_t>(start + r)];
        Nearest& nearest = of_a[static_cast<std::size_t>(start + r)];
        float least = -kNever;
        for (int k = 0; k < count; ++k) {
          row[k] = square_a + squares_b[k] - 2 * row[k];
          least = std::min(least, row[k]);
        }
        if (least < nearest.second)
          for (int k = 0; k < count; ++k) nearest.offer(row[k], from + k);
        float* second_b = seconds.data() + from;
        int nearer = 0;
        for (int k = 0; k < count; ++k) nearer |= static_cast<int>(row[k] < second_b[k]);
        if (nearer == 0) continue;
        for (int k = 0; k < count; ++k) {
          if (row[k] >= second_b[k]) continue;
          Nearest& other = of_b[static_cast<std::size_t>(from + k)];
          other.offer(row[k], start + r);
          second_b[k] = other.second;
        }
      }
    }
  }

  // The distance of bits is their count, that of vectors the root of the squares.
  const double ratio = options.ratio * (kind == FeatureKind::kSift ? options.ratio : 1);
  const auto passes = [&](const Nearest& nearest) {
    return static_cast<double>(nearest.best) < ratio * static_cast<double>(nearest.second);
  };
  std::vector<Match> matches;
  for (int i = 0; i < a.rows; ++i) {
    const Nearest& nearest = of_a[static_cast<std::size_t>(i)];
    if (nearest.index < 0 || !passes(nearest)) continue;
    const Nearest& back = of_b[static_cast<std::size_t>(nearest.index)];
    if (back.index == i) matches.push_back({i, nearest.index});
  }
  return matches;
}

}  // namespace tarsier::sfm
