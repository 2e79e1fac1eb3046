// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/trees.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/trees_inner.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/linalg/gemm.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

namespace tarsier::face::regression {
namespace {

using shape::fit_similarity;
using shape::Similarity2d;

constexpr int kShard = 1024;    // starts per parallel task: fixed, independent of the threads
constexpr int kGathered = 256;  // starts whose residuals are gathered together
constexpr int kThreshold = 64;

Eigen::Matrix2Xd normalized(const Eigen::Matrix2Xd& points) {
  const Eigen::Matrix2Xd centred = points.colwise() - points.rowwise().mean();
  return centred / shape_size(centred);
}

// The mean of the aligned shapes, with their mean orientation.
Eigen::Matrix2Xd upright_mean(const std::vector<TrainingFace>& faces) {
  Eigen::Matrix2Xd upright = Eigen::Matrix2Xd::Zero(2, faces.front().points.cols());
  for (const TrainingFace& face : faces) upright += normalized(face.points);
  TARSIER_REQUIRE(shape_size(upright) > 0, "the shapes have no mean");
  upright = normalized(upright);
  Eigen::Matrix2Xd mean = upright;
  for (int round = 0; round < 10; ++round) {
    Eigen::Matrix2Xd sum = Eigen::Matrix2Xd::Zero(2, mean.cols());
    for (const TrainingFace& face : faces) {
      const Eigen::Matrix2Xd shape = normalized(face.points);
      sum += fit_similarity(shape, mean)(shape);
    }
    sum = normalized(sum);
    mean = normalized(fit_similarity(sum, upright)(sum));
  }
  return mean;
}

// A start and its residual, both in the frame of the start's similarity to the mean.
struct TreeSample {
  const cv::Mat* gray = nullptr;
  Similarity2d px_from_mean;
  Eigen::Matrix2Xd truth;
};

struct Split {
  std::int32_t first = 0;
  std::int32_t second = 0;
  std::int32_t threshold = 0;
  [[nodiscard]] bool right(const std::uint8_t* values) const {
    return values[first] - values[second] > threshold;
  }
};

// Samples order[begin .. end) with the sum of their residuals.
struct Node {
  int begin = 0;
  int end = 0;
  Eigen::VectorXd sum;
  [[nodiscard]] int count() const { return end - begin; }
};

struct Shard {
  int node = 0;
  int begin = 0;
  int end = 0;
};

class TreeTrainer {
 public:
  TreeTrainer(const std::vector<TrainingFace>& faces, const std::vector<Start>& starts,
              const TreesOptions& options, std::stop_token stop)
      : options_(options), stop_(std::move(stop)), random_(options.seed) {
    model_.mean = upright_mean(faces);
    model_.depth = options.depth;
    model_.smoothing = static_cast<float>(options.smoothing);
    width_ = 2 * model_.mean.cols();
    stride_ = (width_ + linalg::kPanel - 1) / linalg::kPanel * linalg::kPanel;
    residuals_.assign(starts.size() * static_cast<std::size_t>(stride_), 0.0F);
    for (const Start& start : starts) {
      const TrainingFace& face = faces[static_cast<std::size_t>(start.face)];
      TreeSample sample{&face.gray, fit_similarity(model_.mean, start.points), {}};
      TARSIER_REQUIRE(sample.px_from_mean.scale() > 0, "a start has no size");
      const Similarity2d mean_from_px = sample.px_from_mean.inverse();
      sample.truth = mean_from_px(face.points);
      const Eigen::VectorXf residual =
          (sample.truth - mean_from_px(start.points)).reshaped().cast<float>();
      std::memcpy(row(samples_.size()), residual.data(),
                  sizeof(float) * static_cast<std::size_t>(residual.size()));
      samples_.push_back(std::move(sample));
    }
  }

  Trees train(Progress& progress) {
    progress.begin("trees", std::int64_t{options_.levels} * options_.trees, "trees");
    for (int l = 0; l < options_.levels; ++l) {
      Rng random = random_.fork(static_cast<std::uint64_t>(l));
      Trees::Level level = draw_pixels(random);
      look_up(level);
      const std::vector<float> before = residuals_;
      const Eigen::Index leaves = Eigen::Index{1} << options_.depth;
      Eigen::MatrixXf moves(width_, options_.trees * leaves);
      for (int t = 0; t < options_.trees; ++t) {
        grow(level, moves.middleCols(t * leaves, leaves), random);
        progress.advance();
      }
      level.set_leaves(moves, options_.components);
      apply(level, before);
      model_.levels.push_back(std::move(level));
    }
    progress.end();
    return std::move(model_);
  }

 private:
  [[nodiscard]] float* row(std::size_t sample) {
    return residuals_.data() + sample * static_cast<std::size_t>(stride_);
  }
  [[nodiscard]] const std::uint8_t* values(int sample) const {
    return values_.data() +
           static_cast<std::size_t>(sample) * static_cast<std::size_t>(options_.features);
  }

  // Runs work(i) for i < count on all threads; begins nothing after a stop request.
  template <typename Work>
  void in_parallel(std::size_t count, const Work& work) {
    cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
      for (int i = range.start; i < range.end && !stop_.stop_requested(); ++i)
        work(static_cast<std::size_t>(i));
    });
    throw_if_stopped(stop_);
  }

  // In the frame of the start.
  [[nodiscard]] Eigen::Matrix2Xd current(std::size_t sample) {
    const Eigen::Map<const Eigen::Matrix2Xf> residual(row(sample), 2, model_.mean.cols());
    return samples_[sample].truth - residual.cast<double>();
  }

  Trees::Level draw_pixels(Rng& random) {
    Trees::Level level;
    const Eigen::Vector2d low = model_.mean.rowwise().minCoeff();
    const Eigen::Vector2d high = model_.mean.rowwise().maxCoeff();
    const Eigen::Vector2d margin = options_.padding * (high - low);
    level.offset.resize(2, options_.features);
    positions_.resize(2, options_.features);
    for (int i = 0; i < options_.features; ++i) {
      const double x = random.uniform(low.x() - margin.x(), high.x() + margin.x());
      const double y = random.uniform(low.y() - margin.y(), high.y() + margin.y());
      const Eigen::Vector2d position(x, y);
      Eigen::Index nearest = 0;
      (model_.mean.colwise() - position).colwise().squaredNorm().minCoeff(&nearest);
      level.anchor.push_back(static_cast<std::int32_t>(nearest));
      level.offset.col(i) = (position - model_.mean.col(nearest)).cast<float>();
      positions_.col(i) = position;
    }
    return level;
  }

  void look_up(const Trees::Level& level) {
    values_.resize(samples_.size() * static_cast<std::size_t>(options_.features));
    in_parallel(samples_.size(), [&](std::size_t s) {
      const TreeSample& sample = samples_[s];
      const Eigen::Matrix2Xd shape = current(s);
      inner::look_up(level, model_.smoothing, *sample.gray,
                     sample.px_from_mean * fit_similarity(model_.mean, shape),
                     sample.px_from_mean(shape),
                     values_.data() + s * static_cast<std::size_t>(options_.features));
    });
  }

  Split draw_split(Rng& random) const {
    Split split;
    // Near pixels are compared more often: their difference is more informative and robust to
    // light. If there are few near pixels, any pair is finally accepted.
    for (int attempt = 0; attempt < 10000; ++attempt) {
      split.first = random.integer(0, options_.features - 1);
      split.second = random.integer(0, options_.features - 1);
      if (split.first == split.second) continue;
      const double distance = (positions_.col(split.first) - positions_.col(split.second)).norm();
      if (random.uniform() < std::exp(-distance / options_.nearness)) break;
    }
    split.threshold = random.integer(-kThreshold, kThreshold);
    return split;
  }

  // For samples order_[begin .. end): the sums of residuals that each split sends left (tests x
  // stride_), and their counts.
  void sum_left(const Shard& shard, const Split* splits, float* sums, std::int32_t* counts) {
    const auto tests = static_cast<std::size_t>(options_.tests);
    const auto stride = static_cast<std::size_t>(stride_);
    std::vector<float> left(tests * kGathered);
    std::vector<float> rows(kGathered * stride);
    std::vector<float> product(tests * linalg::kPanel);
    std::fill(sums, sums + tests * stride, 0.0F);
    std::fill(counts, counts + tests, 0);
    for (int begin = shard.begin; begin < shard.end; begin += kGathered) {
      const int size = std::min(kGathered, shard.end - begin);
      for (int k = 0; k < size; ++k) {
        const int sample = order_[static_cast<std::size_t>(begin + k)];
        std::memcpy(rows.data() + static_cast<std::size_t>(k) * stride,
                    row(static_cast<std::size_t>(sample)), stride * sizeof(float));
        const std::uint8_t* pixels = values(sample);
        for (std::size_t t = 0; t < tests; ++t) {
          const bool goes_left = !splits[t].right(pixels);
          counts[t] += static_cast<std::int32_t>(goes_left);
          left[static_cast<std::size_t>(k) * tests + t] = goes_left ? 1.0F : 0.0F;
        }
      }
      for (std::size_t first = 0; first < stride; first += linalg::kPanel) {
        linalg::gemm_kernels().panel(options_.tests, size, left.data(), 1, options_.tests,
                                     rows.data() + first, stride_, product.data());
        for (std::size_t t = 0; t < tests; ++t)
          for (std::size_t i = 0; i < linalg::kPanel; ++i)
            sums[t * stride + first + i] += product[t * linalg::kPanel + i];
      }
    }
  }

  // Sets split and children of each node of a layer.
  std::vector<Node> split_layer(const std::vector<Node>& layer, Rng& random,
                                std::vector<Split>& chosen) {
    const auto tests = static_cast<std::size_t>(options_.tests);
    const auto stride = static_cast<std::size_t>(stride_);
    std::vector<Split> splits(layer.size() * tests);
    for (Split& split : splits) split = draw_split(random);
    std::vector<Shard> shards;
    std::vector<std::size_t> first_shard;
    for (std::size_t n = 0; n < layer.size(); ++n) {
      first_shard.push_back(shards.size());
      for (int begin = layer[n].begin; begin < layer[n].end; begin += kShard)
        shards.push_back({static_cast<int>(n), begin, std::min(begin + kShard, layer[n].end)});
    }
    first_shard.push_back(shards.size());
    sums_.resize(shards.size() * tests * stride);
    counts_.resize(shards.size() * tests);
    in_parallel(shards.size(), [&](std::size_t s) {
      sum_left(shards[s], splits.data() + static_cast<std::size_t>(shards[s].node) * tests,
               sums_.data() + s * tests * stride, counts_.data() + s * tests);
    });

    // Sum over all shards of a node, in their order.
    const auto left_of = [&](std::size_t n, std::size_t t) {
      std::pair<Eigen::VectorXd, int> left{Eigen::VectorXd::Zero(width_), 0};
      for (std::size_t s = first_shard[n]; s < first_shard[n + 1]; ++s) {
        const Eigen::Map<const Eigen::VectorXf> sum(sums_.data() + (s * tests + t) * stride,
                                                    width_);
        left.first += sum.cast<double>();
        left.second += counts_[s * tests + t];
      }
      return left;
    };
    std::vector<double> gains(splits.size());
    in_parallel(splits.size(), [&](std::size_t i) {
      const Node& node = layer[i / tests];
      const auto [left, count] = left_of(i / tests, i % tests);
      const int rest = node.count() - count;
      gains[i] = (count > 0 ? left.squaredNorm() / count : 0.0) +
                 (rest > 0 ? (node.sum - left).squaredNorm() / rest : 0.0);
    });
    std::vector<Node> below(2 * layer.size());
    const std::size_t first_chosen = chosen.size();
    chosen.resize(first_chosen + layer.size());
    in_parallel(layer.size(), [&](std::size_t n) {
      const auto candidates = gains.begin() + static_cast<std::ptrdiff_t>(n * tests);
      const auto best = static_cast<std::size_t>(
          std::max_element(candidates, candidates + static_cast<std::ptrdiff_t>(tests)) -
          candidates);
      const Split& split = splits[n * tests + best];
      auto left = left_of(n, best);
      const auto begin = order_.begin() + layer[n].begin;
      std::stable_partition(begin, order_.begin() + layer[n].end,
                            [&](int sample) { return !split.right(values(sample)); });
      const int middle = layer[n].begin + left.second;
      below[2 * n + 1] = {middle, layer[n].end, layer[n].sum - left.first};
      below[2 * n] = {layer[n].begin, middle, std::move(left.first)};
      chosen[first_chosen + n] = split;
    });
    return below;
  }

  // Residuals after a level with compressed leaves, from the residuals before it.
  void apply(const Trees::Level& level, const std::vector<float>& before) {
    in_parallel(samples_.size(), [&](std::size_t s) {
      Eigen::VectorXi sums = Eigen::VectorXi::Zero(level.basis.cols());
      inner::add_leaves(level, options_.depth, values(static_cast<int>(s)), sums.data());
      const Eigen::Map<const Eigen::VectorXf> old(
          before.data() + s * static_cast<std::size_t>(stride_), width_);
      Eigen::Map<Eigen::VectorXf>(row(s), width_) = old - level.basis * sums.cast<float>();
    });
  }

  // Grows one tree of a level with its leaves' `moves` (2n x leaves), and updates the residuals.
  void grow(Trees::Level& level, Eigen::Ref<Eigen::MatrixXf> moves, Rng& random) {
    order_.resize(samples_.size());
    std::iota(order_.begin(), order_.end(), 0);
    std::vector<Node> layer{{0, static_cast<int>(order_.size()), residual_sum()}};
    std::vector<Split> chosen;
    for (int d = 0; d < options_.depth; ++d) layer = split_layer(layer, random, chosen);
    for (const Split& split : chosen) {
      level.first.push_back(split.first);
      level.second.push_back(split.second);
      level.threshold.push_back(static_cast<std::int16_t>(split.threshold));
    }
    moves.setZero();
    in_parallel(layer.size(), [&](std::size_t n) {
      if (layer[n].count() == 0) return;
      const Eigen::VectorXf move =
          (layer[n].sum * (options_.shrinkage / layer[n].count())).cast<float>();
      moves.col(static_cast<Eigen::Index>(n)) = move;
      for (int k = layer[n].begin; k < layer[n].end; ++k) {
        const auto sample = static_cast<std::size_t>(order_[static_cast<std::size_t>(k)]);
        Eigen::Map<Eigen::VectorXf>(row(sample), width_) -= move;
      }
    });
  }

  Eigen::VectorXd residual_sum() {
    const std::size_t shards = (samples_.size() + kShard - 1) / kShard;
    Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(width_, static_cast<Eigen::Index>(shards));
    in_parallel(shards, [&](std::size_t shard) {
      auto sum = sums.col(static_cast<Eigen::Index>(shard));
      const std::size_t end = std::min((shard + 1) * kShard, samples_.size());
      for (std::size_t s = shard * kShard; s < end; ++s)
        sum += Eigen::Map<const Eigen::VectorXf>(row(s), width_).cast<double>();
    });
    Eigen::VectorXd total = Eigen::VectorXd::Zero(width_);
    for (Eigen::Index c = 0; c < sums.cols(); ++c) total += sums.col(c);
    return total;
  }

  TreesOptions options_;
  std::stop_token stop_;
  Rng random_;
  Trees model_;
  Eigen::Index width_ = 0;  // length of a shape
  // Stride of a row of residuals: whole panels of the product, 0 beyond width_.
  Eigen::Index stride_ = 0;
  std::vector<TreeSample> samples_;
  std::vector<float> residuals_;      // truth minus current shape, one row per sample
  std::vector<std::uint8_t> values_;  // grey values of the level's pixels, one row per sample
  Eigen::Matrix2Xd positions_;        // of the level's pixels in the mean's frame
  std::vector<int> order_;            // samples, grouped by node
  std::vector<float> sums_;           // shards x tests x stride_
  std::vector<std::int32_t> counts_;  // shards x tests
};

}  // namespace

Trees train_trees(const std::vector<TrainingFace>& faces, const std::vector<Start>& starts,
                  const TreesOptions& options, Progress& progress, const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(!faces.empty(), "no faces to learn from");
  TARSIER_REQUIRE(!starts.empty() && starts.size() <= 10'000'000, "{} starts to learn from",
                  starts.size());
  const Eigen::Index points = faces.front().points.cols();
  TARSIER_REQUIRE(points >= 2 && points <= 1000, "{} points, 2..1000 are possible", points);
  for (const TrainingFace& face : faces) {
    TARSIER_REQUIRE(face.gray.type() == CV_8UC1 && !face.gray.empty(), "{}: no 8 bit gray image",
                    face.name);
    TARSIER_REQUIRE(face.points.cols() == points, "{}: {} points, others have {}", face.name,
                    face.points.cols(), points);
    TARSIER_REQUIRE(face.points.allFinite() && shape_size(face.points) > 0,
                    "{}: a shape without size", face.name);
  }
  for (const Start& start : starts) {
    TARSIER_REQUIRE(start.face >= 0 && static_cast<std::size_t>(start.face) < faces.size(),
                    "a start of face {} of {}", start.face, faces.size());
    TARSIER_REQUIRE(start.points.cols() == points && start.points.allFinite(),
                    "a start with {} points of {}", start.points.cols(), points);
  }
  throw_if_stopped(stop);
  return TreeTrainer(faces, starts, options, stop).train(progress);
}

}  // namespace tarsier::face::regression
