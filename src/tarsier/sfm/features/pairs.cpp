// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/pairs.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/mixed_index.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/words.h"
#include "tarsier/linalg/gemm.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <string_view>

namespace tarsier::sfm {
namespace {

constexpr int kMaxSamples = 50'000;      // for the vocabulary, for any number of images
constexpr int kMinSampledPerImage = 20;  // min per image; fewer do not justify reading it
constexpr int kClusterIterations = 20;   // of k-means; more hardly change search results
constexpr int kRows = 128;               // rows at a time, so that their scores fit into the cache
constexpr int kBatch = 16;               // images whose descriptors are in memory at a time
constexpr int kDepth = 512;  // length of a partial product of VLAD vectors, for the cache
// share of a similarity that remains at twice the rank
constexpr float kMinSimilarityRatio = 0.85F;
constexpr int kMaxLineBytes = 1 << 16;

std::size_t row_start(std::ptrdiff_t row, std::ptrdiff_t width) {
  return static_cast<std::size_t>(row * width);
}

void sort_unique(std::vector<ImagePair>& pairs) {
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
}

// Descriptors as numbers, one row each. Bits become +-1, so that scalar products count equal bits.
int depth_of(const cv::Mat& descriptors, FeatureKind kind) {
  return descriptors.cols * (kind == FeatureKind::kSift ? 1 : 8);
}

void to_floats(const std::uint8_t* in, int depth, FeatureKind kind, float* out) {
  if (kind == FeatureKind::kSift) {
    for (int k = 0; k < depth; ++k) out[k] = static_cast<float>(in[k]);
  } else {
    for (int k = 0; k < depth; ++k) out[k] = (in[k / 8] >> (k % 8) & 1) != 0 ? 1.0F : -1.0F;
  }
}

// Rows of numbers of equal length.
struct Table {
  int depth = 0;
  std::vector<float> values;

  [[nodiscard]] int rows() const {
    return depth == 0 ? 0 : static_cast<int>(values.size()) / depth;
  }
  [[nodiscard]] const float* row(int r) const { return values.data() + row_start(r, depth); }
  [[nodiscard]] float* row(int r) { return values.data() + row_start(r, depth); }
};

// The words, and data for finding the nearest one.
class Vocabulary {
 public:
  Vocabulary() = default;
  explicit Vocabulary(Table words) : words_(std::move(words)) {
    const int count = words_.rows();
    stride_ = (count + linalg::kPanel - 1) / linalg::kPanel * linalg::kPanel;
    columns_.assign(row_start(words_.depth, stride_), 0);
    halves_.assign(static_cast<std::size_t>(count), 0);
    for (int w = 0; w < count; ++w) {
      const float* in = words_.row(w);
      float sum = 0;
      for (int k = 0; k < words_.depth; ++k) {
        columns_[row_start(k, stride_) + static_cast<std::size_t>(w)] = in[k];
        sum += in[k] * in[k];
      }
      halves_[static_cast<std::size_t>(w)] = sum / 2;
    }
  }

  [[nodiscard]] const Table& words() const { return words_; }

  // The nearest word of each of `count` <= kRows rows; the first of equally near ones.
  void find(const float* rows, int count, int* nearest) const {
    float products[kRows * linalg::kPanel];
    float best[kRows];
    std::fill_n(best, count, -std::numeric_limits<float>::infinity());
    std::fill_n(nearest, count, 0);
    for (int from = 0; from < stride_; from += linalg::kPanel) {
      linalg::gemm_kernels().panel(count, words_.depth, rows, words_.depth, 1,
                                   columns_.data() + from, stride_, products);
      const int columns = std::min(linalg::kPanel, words_.rows() - from);
      for (int r = 0; r < count; ++r) {
        for (int c = 0; c < columns; ++c) {
          const float score =
              products[r * linalg::kPanel + c] - halves_[static_cast<std::size_t>(from + c)];
          if (score > best[r]) {
            best[r] = score;
            nearest[r] = from + c;
          }
        }
      }
    }
  }

 private:
  Table words_;
  int stride_ = 0;
  std::vector<float> columns_;  // the words, in panels
  std::vector<float> halves_;   // half of each word's squared length
};

// k-means++: each next word is a sample, with a probability that grows with its distance from the
// words.
Table first_words(const Table& samples, int most, Rng& rng) {
  const int count = samples.rows();
  const int depth = samples.depth;
  const linalg::GemmKernels& kernels = linalg::gemm_kernels();
  std::vector<float> squares(static_cast<std::size_t>(count), 0);
  for (int i = 0; i < count; ++i)
    kernels.dots(1, 1, depth, samples.row(i), depth, samples.row(i), depth,
                 &squares[static_cast<std::size_t>(i)], 1);
  std::vector<double> distances(static_cast<std::size_t>(count),
                                std::numeric_limits<double>::infinity());
  Table words{depth, {}};
  int chosen = rng.integer(0, count - 1);
  while (true) {
    const float* word = samples.row(chosen);
    words.values.insert(words.values.end(), word, word + depth);
    if (words.rows() == most) break;
    const float square = squares[static_cast<std::size_t>(chosen)];
    cv::parallel_for_(cv::Range(0, (count + kRows - 1) / kRows), [&](const cv::Range& range) {
      for (int block = range.start; block < range.end; ++block) {
        const int start = block * kRows;
        const int rows = std::min(kRows, count - start);
        float products[kRows] = {};
        kernels.dots(rows, 1, depth, samples.row(start), depth, word, depth, products, 1);
        for (int r = 0; r < rows; ++r) {
          const auto i = static_cast<std::size_t>(start + r);
          // Exact, as samples are small integers: 0 for a sample that is already a word.
          const float distance = squares[i] + square - 2 * products[r];
          distances[i] = std::min(distances[i], static_cast<double>(distance));
        }
      }
    });
    const double total = std::accumulate(distances.begin(), distances.end(), 0.0);
    if (total <= 0) break;  // all samples are words
    double rest = rng.uniform() * total;
    chosen = -1;
    for (int i = 0; i < count; ++i) {
      const double distance = distances[static_cast<std::size_t>(i)];
      if (distance <= 0) continue;
      chosen = i;  // the last one if rounding leaves a rest
      rest -= distance;
      if (rest < 0) break;
    }
  }
  return words;
}

Vocabulary make_vocabulary(const Table& samples, int most, Rng& rng) {
  const int count = samples.rows();
  if (count == 0) return {};
  Vocabulary vocabulary(first_words(samples, most, rng));
  std::vector<int> nearest(static_cast<std::size_t>(count), -1);
  for (int iteration = 0; iteration < kClusterIterations; ++iteration) {
    const std::vector<int> before = nearest;
    cv::parallel_for_(cv::Range(0, (count + kRows - 1) / kRows), [&](const cv::Range& range) {
      for (int block = range.start; block < range.end; ++block) {
        const int start = block * kRows;
        vocabulary.find(samples.row(start), std::min(kRows, count - start), nearest.data() + start);
      }
    });
    if (nearest == before) break;
    // Summed in the order of the samples, so that the number of threads has no effect.
    Table words = vocabulary.words();
    std::vector<double> sums(words.values.size(), 0);
    std::vector<int> members(static_cast<std::size_t>(words.rows()), 0);
    for (int i = 0; i < count; ++i) {
      const int word = nearest[static_cast<std::size_t>(i)];
      const float* in = samples.row(i);
      double* sum = sums.data() + row_start(word, words.depth);
      for (int k = 0; k < words.depth; ++k) sum[k] += static_cast<double>(in[k]);
      ++members[static_cast<std::size_t>(word)];
    }
    for (int w = 0; w < words.rows(); ++w) {
      const int of_word = members[static_cast<std::size_t>(w)];
      if (of_word == 0) continue;  // an empty word keeps its position
      const double* sum = sums.data() + row_start(w, words.depth);
      for (int k = 0; k < words.depth; ++k) words.row(w)[k] = static_cast<float>(sum[k] / of_word);
    }
    vocabulary = Vocabulary(std::move(words));
  }
  return vocabulary;
}

// Takes some rows of one image, by a partial shuffle.
void add_samples(const cv::Mat& descriptors, FeatureKind kind, int most, Rng rng, Table& samples) {
  std::vector<int> order(static_cast<std::size_t>(descriptors.rows));
  std::iota(order.begin(), order.end(), 0);
  const int count = std::min(most, descriptors.rows);
  for (int i = 0; i < count; ++i) {
    const int other = rng.integer(i, descriptors.rows - 1);
    std::swap(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(other)]);
    samples.values.resize(samples.values.size() + static_cast<std::size_t>(samples.depth));
    to_floats(descriptors.ptr(order[static_cast<std::size_t>(i)]), samples.depth, kind,
              samples.row(samples.rows() - 1));
  }
}

// The VLAD vector of one image, of length 1. Empty where it has no descriptors, or all of them are
// words.
std::vector<float> vlad(const cv::Mat& descriptors, FeatureKind kind,
                        const Vocabulary& vocabulary) {
  const Table& words = vocabulary.words();
  std::vector<float> result(words.values.size(), 0);
  Table rows{words.depth, std::vector<float>(row_start(kRows, words.depth))};
  int nearest[kRows];
  for (int start = 0; start < descriptors.rows; start += kRows) {
    const int count = std::min(kRows, descriptors.rows - start);
    for (int r = 0; r < count; ++r)
      to_floats(descriptors.ptr(start + r), words.depth, kind, rows.row(r));
    vocabulary.find(rows.values.data(), count, nearest);
    for (int r = 0; r < count; ++r) {
      const float* in = rows.row(r);
      const float* word = words.row(nearest[r]);
      float* out = result.data() + row_start(nearest[r], words.depth);
      for (int k = 0; k < words.depth; ++k) out[k] += in[k] - word[k];
    }
  }
  double total = 0;
  for (int w = 0; w < words.rows(); ++w) {
    float* part = result.data() + row_start(w, words.depth);
    double square = 0;
    for (int k = 0; k < words.depth; ++k) square += static_cast<double>(part[k] * part[k]);
    if (square <= 0) continue;
    const auto scale = static_cast<float>(1 / std::sqrt(square));
    for (int k = 0; k < words.depth; ++k) {
      part[k] = std::copysign(std::sqrt(std::abs(part[k]) * scale), part[k]);
      total += static_cast<double>(part[k] * part[k]);
    }
  }
  if (total <= 0) return {};
  const auto scale = static_cast<float>(1 / std::sqrt(total));
  for (float& value : result) value *= scale;
  return result;
}

// Whether an image is at most as far from image `from` as the `most` nearest ones.
class IsNearPosition {
 public:
  IsNearPosition(const KnownPositions& positions, int from, int most)
      : positions_(positions), from_(*positions[static_cast<std::size_t>(from)]) {
    std::vector<double> distances;
    for (std::size_t i = 0; i < positions.size(); ++i)
      if (positions[i] && static_cast<int>(i) != from) distances.push_back(squared(*positions[i]));
    if (static_cast<int>(distances.size()) <= most) return;  // all are near
    std::nth_element(distances.begin(), distances.begin() + most - 1, distances.end());
    farthest_ = distances[static_cast<std::size_t>(most - 1)];
  }

  [[nodiscard]] bool operator()(int image) const {
    const auto& position = positions_[static_cast<std::size_t>(image)];
    return position && squared(*position) <= farthest_;
  }

 private:
  [[nodiscard]] double squared(const Eigen::Vector3d& position) const {
    return (position - from_).squaredNorm();
  }

  const KnownPositions& positions_;
  const Eigen::Vector3d from_;
  double farthest_ = std::numeric_limits<double>::infinity();
};

// Orders images by descending similarity, then by index.
struct IsMoreSimilar {
  const float* similarities;

  bool operator()(int a, int b) const {
    return similarities[a] != similarities[b] ? similarities[a] > similarities[b] : a < b;
  }
};

// The images at 2, 4, 8, .. times the rank `nearest` from image `from` that are added for it, while
// each is nearly as similar as the previous one. Only one in 2, 4, 8, .. images adds them. Reorders
// `images`.
std::vector<int> farther_images(int from, std::vector<int>& images, int nearest,
                                const float* similarities) {
  std::vector<int> farther;
  const std::uint32_t mixed = mixed_index(from);
  float before = std::numeric_limits<float>::infinity();
  int doublings = 0;
  for (std::ptrdiff_t rank = nearest; rank <= std::ssize(images); rank *= 2, ++doublings) {
    const auto other = images.begin() + rank - 1;
    std::nth_element(images.begin(), other, images.end(), IsMoreSimilar{similarities});
    const float similarity = similarities[*other];
    if (doublings > 0) {
      if (!(similarity > 0 && similarity >= kMinSimilarityRatio * before)) break;
      if (mixed >> (32 - doublings) == 0) farther.push_back(*other);
    }
    before = similarity;
  }
  return farther;
}

}  // namespace

std::vector<ImagePair> exhaustive_pairs(int count) {
  TARSIER_REQUIRE(count >= 0, "{} images", count);
  std::vector<ImagePair> pairs;
  for (int i = 0; i < count; ++i)
    for (int j = i + 1; j < count; ++j) pairs.emplace_back(i, j);
  return pairs;
}

std::vector<ImagePair> sequential_pairs(int count, int overlap) {
  TARSIER_REQUIRE(count >= 0, "{} images", count);
  TARSIER_REQUIRE(overlap >= 1, "overlap {}", overlap);
  std::vector<ImagePair> pairs;
  for (int i = 0; i < count; ++i) {
    const int rest = count - 1 - i;
    for (int step = 1; step <= std::min(overlap, rest); ++step) pairs.emplace_back(i, i + step);
    for (std::int64_t step = 2; step <= rest; step *= 2)
      if (step > overlap) pairs.emplace_back(i, i + static_cast<int>(step));
  }
  return pairs;
}

std::vector<ImagePair> read_pairs_list(const std::string& path,
                                       const std::vector<std::string>& names) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(path, "no such file");
  if (!std::filesystem::is_regular_file(status)) throw InputError(path, "is not a regular file");
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(path, "cannot read");
  std::map<std::string_view, int> indices;
  for (std::size_t i = 0; i < names.size(); ++i) indices.emplace(names[i], static_cast<int>(i));

  constexpr std::string_view kSpace = " \t\r";
  std::vector<ImagePair> pairs;
  std::vector<char> buffer(kMaxLineBytes);
  for (int number = 1; stream.getline(buffer.data(), kMaxLineBytes) || stream.gcount() > 0;
       ++number) {
    const auto fail = [&](const std::string& reason) {
      throw InputError(path, fmt::format("line {}: {}", number, reason));
    };
    if (stream.fail()) fail(fmt::format("longer than the limit of {} bytes", kMaxLineBytes));
    std::string_view line(buffer.data());
    for (std::size_t mark = line.find('#'); mark != std::string_view::npos;
         mark = line.find('#', mark + 1)) {
      if (mark == 0 || kSpace.find(line[mark - 1]) != std::string_view::npos) {
        line = line.substr(0, mark);
        break;
      }
    }
    line = trimmed(line);
    if (line.empty()) continue;
    // All ways to read the line as two names.
    std::set<ImagePair> found;
    for (std::size_t gap = line.find_first_of(kSpace); gap != std::string_view::npos;
         gap = line.find_first_of(kSpace, gap + 1)) {
      const auto first = indices.find(trimmed(line.substr(0, gap)));
      const auto second = indices.find(trimmed(line.substr(gap)));
      if (first != indices.end() && second != indices.end())
        found.insert(std::minmax(first->second, second->second));
    }
    if (found.empty()) {
      std::string_view rest = line;
      const std::string_view first = next_word(rest);
      const std::string_view second = next_word(rest);
      if (second.empty()) fail("expected the names of two images");
      if (!trimmed(rest).empty())
        fail(fmt::format("'{}' does not name two images: expected two image names per line",
                         printable(line.substr(0, 200))));
      const std::string_view unknown = indices.count(first) == 0 ? first : second;
      fail(fmt::format("no image is named '{}'", printable(unknown.substr(0, 200))));
    }
    if (found.size() > 1) fail("the line is ambiguous, because image names contain spaces");
    if (found.begin()->first == found.begin()->second)
      fail(fmt::format("'{}' is paired with itself",
                       printable(names[static_cast<std::size_t>(found.begin()->first)])));
    pairs.push_back(*found.begin());
  }
  if (stream.bad()) throw InputError(path, "cannot read");
  sort_unique(pairs);
  return pairs;
}

Retrieval::Retrieval(int count, const DescriptorSource& source, FeatureKind kind,
                     const RetrievalOptions& options)
    : options_(options) {
  options.check();
  TARSIER_REQUIRE(count >= 0, "{} images", count);
  int depth = 0;
  const auto descriptors_of = [&](int image) {
    cv::Mat descriptors = source(image);
    if (descriptors.empty()) return cv::Mat();
    TARSIER_REQUIRE(descriptors.type() == CV_8UC1, "descriptors of type {}", descriptors.type());
    const int own = depth_of(descriptors, kind);
    if (depth == 0) depth = own;
    TARSIER_REQUIRE(own == depth, "descriptors of {} and {} dimensions", depth, own);
    return descriptors;
  };

  // Of many images only some descriptors are taken, evenly, which limits the cost.
  Rng rng(options.seed);
  const int share = std::max(kMinSampledPerImage, kMaxSamples / std::max(1, count));
  const int most = std::min(options.sampled, share);
  const int sampled_images = std::min(count, std::max(1, kMaxSamples / most));
  Table samples;
  for (int i = 0; i < sampled_images; ++i) {
    const auto image = static_cast<int>(static_cast<std::int64_t>(i) * count / sampled_images);
    const cv::Mat descriptors = descriptors_of(image);
    samples.depth = depth;
    if (!descriptors.empty())
      add_samples(descriptors, kind, most, rng.fork(static_cast<std::uint64_t>(image)), samples);
  }
  const Vocabulary vocabulary = make_vocabulary(samples, options.words, rng);
  samples = {};

  length_ = static_cast<int>(vocabulary.words().values.size());
  vectors_.assign(row_start(count, length_), 0);
  scales_.assign(static_cast<std::size_t>(count), 0);
  if (length_ == 0) return;
  for (int start = 0; start < count; start += kBatch) {
    std::vector<cv::Mat> batch;
    for (int i = start; i < std::min(count, start + kBatch); ++i)
      batch.push_back(descriptors_of(i));
    cv::parallel_for_(cv::Range(0, static_cast<int>(batch.size())), [&](const cv::Range& range) {
      for (int b = range.start; b < range.end; ++b) {
        const std::vector<float> values =
            vlad(batch[static_cast<std::size_t>(b)], kind, vocabulary);
        float largest = 0;
        for (const float value : values) largest = std::max(largest, std::abs(value));
        if (largest <= 0) continue;
        scales_[static_cast<std::size_t>(start + b)] = largest / 127;
        std::int8_t* out = vectors_.data() + row_start(start + b, length_);
        for (std::size_t k = 0; k < values.size(); ++k)
          out[k] = static_cast<std::int8_t>(std::lround(values[k] / largest * 127));
      }
    });
  }
}

double Retrieval::similarity(int first, int second) const {
  TARSIER_REQUIRE(first >= 0 && first < count() && second >= 0 && second < count(),
                  "images {} and {} of {}", first, second, count());
  const std::int8_t* a = vectors_.data() + row_start(first, length_);
  const std::int8_t* b = vectors_.data() + row_start(second, length_);
  std::int64_t product = 0;
  for (int k = 0; k < length_; ++k) product += a[k] * b[k];
  return static_cast<double>(product) *
         static_cast<double>(scales_[static_cast<std::size_t>(first)]) *
         static_cast<double>(scales_[static_cast<std::size_t>(second)]);
}

std::vector<ImagePair> Retrieval::pairs(const KnownPositions& positions) const {
  const int images = count();
  TARSIER_REQUIRE(positions.empty() || static_cast<int>(positions.size()) == images,
                  "{} positions for {} images", positions.size(), images);
  for (const auto& position : positions)
    TARSIER_REQUIRE(!position || position->allFinite(), "a position is not finite");
  const int blocks = (images + kRows - 1) / kRows;
  std::vector<std::vector<ImagePair>> of_block(static_cast<std::size_t>(blocks));
  cv::parallel_for_(cv::Range(0, blocks), [&](const cv::Range& range) {
    std::vector<float> left(row_start(kRows, kDepth));
    std::vector<float> right(row_start(kDepth, linalg::kPanel));
    std::vector<float> products(row_start(kRows, linalg::kPanel));
    std::vector<float> scores(row_start(kRows, images));
    std::vector<int> order;
    for (int block = range.start; block < range.end; ++block) {
      const int start = block * kRows;
      const int rows = std::min(kRows, images - start);
      std::fill(scores.begin(), scores.end(), 0.0F);
      for (int from = 0; from < length_; from += kDepth) {
        const int depth = std::min(kDepth, length_ - from);
        for (int r = 0; r < rows; ++r) {
          const std::int8_t* in = vectors_.data() + row_start(start + r, length_) + from;
          std::copy(in, in + depth, left.data() + row_start(r, kDepth));
        }
        for (int panel = 0; panel < images; panel += linalg::kPanel) {
          const int columns = std::min(linalg::kPanel, images - panel);
          for (int c = 0; c < columns; ++c) {
            const std::int8_t* in = vectors_.data() + row_start(panel + c, length_) + from;
            for (int k = 0; k < depth; ++k)
              right[row_start(k, linalg::kPanel) + static_cast<std::size_t>(c)] = in[k];
          }
          linalg::gemm_kernels().panel(rows, depth, left.data(), kDepth, 1, right.data(),
                                       linalg::kPanel, products.data());
          for (int r = 0; r < rows; ++r) {
            const float* in = products.data() + row_start(r, linalg::kPanel);
            float* out = scores.data() + row_start(r, images) + panel;
            for (int c = 0; c < columns; ++c) out[c] += in[c];
          }
        }
      }
      for (int r = 0; r < rows; ++r) {
        const int image = start + r;
        if (scales_[static_cast<std::size_t>(image)] <= 0) continue;
        order.clear();
        float* row = scores.data() + row_start(r, images);
        for (int other = 0; other < images; ++other) {
          const float scale = scales_[static_cast<std::size_t>(other)];
          if (other == image || scale <= 0) continue;
          row[other] *= scale;
          order.push_back(other);
        }
        for (const int other : farther_images(image, order, options_.nearest, row))
          of_block[static_cast<std::size_t>(block)].emplace_back(std::minmax(image, other));
        const IsMoreSimilar is_more_similar{row};
        const auto first_of = [&](std::ptrdiff_t most) {
          return order.begin() + std::min(most, static_cast<std::ptrdiff_t>(order.size()));
        };
        const bool has_position =
            !positions.empty() && positions[static_cast<std::size_t>(image)].has_value();
        const int by_similarity =
            has_position ? std::max(1, options_.nearest / 3) : options_.nearest;
        auto chosen = first_of(by_similarity);
        std::partial_sort(order.begin(), chosen, order.end(), is_more_similar);
        if (has_position) {
          const auto near = std::partition(chosen, order.end(),
                                           IsNearPosition(positions, image, 4 * options_.nearest));
          const auto end = std::min(near, first_of(options_.nearest));
          std::partial_sort(chosen, end, near, is_more_similar);
          chosen = end;
        }
        for (auto other = order.begin(); other != chosen; ++other)
          of_block[static_cast<std::size_t>(block)].emplace_back(std::minmax(image, *other));
      }
    }
  });
  std::vector<ImagePair> pairs;
  for (const auto& some : of_block) pairs.insert(pairs.end(), some.begin(), some.end());
  sort_unique(pairs);
  return pairs;
}

}  // namespace tarsier::sfm
