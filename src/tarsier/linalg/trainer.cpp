// SPDX-License-Identifier: MIT
#include "tarsier/linalg/trainer.h"

#include "tarsier/core/log.h"
#include "tarsier/core/measures.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/gather.h"
#include "tarsier/linalg/gemm.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <exception>
#include <numbers>
#include <utility>

namespace tarsier::linalg {
namespace {

constexpr int kChunk = 1024;  // number of pixels whose patches are laid out together
constexpr int kMinDotLength =
    512;  // from this length on, dot products are faster than a transposition

void backward_maximum(const Layer& layer, const float* input, Shape from, Shape to,
                      const float* output_gradient, std::vector<float>& input_gradient) {
  input_gradient.assign(from.size() + kPanel, 0.0F);
  for (int c = 0; c < to.channels; ++c) {
    const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(c) * from.height * from.width;
    for (int y = 0; y < to.height; ++y) {
      for (int x = 0; x < to.width; ++x) {
        const std::ptrdiff_t corner = plane +
                                      static_cast<std::ptrdiff_t>(y * layer.kernel_y) * from.width +
                                      static_cast<std::ptrdiff_t>(x) * layer.kernel_x;
        std::ptrdiff_t best = corner;
        float largest = input[corner];
        for (int v = 0; v < layer.kernel_y; ++v) {
          for (int u = 0; u < layer.kernel_x; ++u) {
            // No branches, because the largest pixel is unpredictable.
            const std::ptrdiff_t at = corner + v * from.width + u;
            best = input[at] > largest ? at : best;
            largest = std::max(largest, input[at]);
          }
        }
        input_gradient[static_cast<std::size_t>(best)] += *output_gradient++;
      }
    }
  }
}

// rows x columns -> columns x `padded_depth`, in blocks that fit into the L1 cache.
void transpose(const float* from, int rows, int columns, int padded_depth, std::vector<float>& to) {
  constexpr int kBlock = 16;
  to.resize(static_cast<std::size_t>(columns) * static_cast<std::size_t>(padded_depth));
  for (int r = 0; r < rows; r += kBlock) {
    for (int c = 0; c < columns; c += kBlock) {
      const int last_row = std::min(r + kBlock, rows);
      const int last_column = std::min(c + kBlock, columns);
      for (int j = c; j < last_column; ++j)
        for (int i = r; i < last_row; ++i)
          to[static_cast<std::size_t>(j) * static_cast<std::size_t>(padded_depth) +
             static_cast<std::size_t>(i)] = from[static_cast<std::ptrdiff_t>(i) * columns + j];
    }
  }
}

void weight_gradient(const Layer& layer, const Padded& source, Shape to, const float* derivative,
                     Gradient::LayerGradient& gradient, BackwardWorkspace& workspace) {
  const int pixels = to.height * to.width;
  const GemmKernels& kernels = gemm_kernels();
  const auto depth = static_cast<std::size_t>(layer.depth());
  if (pixels == 1) {
    workspace.columns.resize(depth);
    gather(layer, source, to, 0, 1, 1, workspace.columns.data());
    for (int o = 0; o < layer.out; ++o) {
      float* row = gradient.weights.data() + static_cast<std::size_t>(o) * depth;
      for (std::size_t k = 0; k < depth; ++k) row[k] += derivative[o] * workspace.columns[k];
    }
  }
  // dW = derivative x patches^T, with the patches laid out by pixel for the same product.
  const int padded_depth = (layer.depth() + kPanel - 1) / kPanel * kPanel;
  workspace.product.resize(static_cast<std::size_t>(layer.out) * kPanel);
  for (int begin = 0; begin < pixels && pixels > 1; begin += kChunk) {
    const int count = std::min(kChunk, pixels - begin);
    workspace.columns.resize(depth * static_cast<std::size_t>(count));
    gather(layer, source, to, begin, count, count, workspace.columns.data());
    if (count >= kMinDotLength) {
      kernels.dots(layer.out, layer.depth(), count, derivative + begin, pixels,
                   workspace.columns.data(), count, gradient.weights.data(), layer.depth());
      continue;
    }
    transpose(workspace.columns.data(), layer.depth(), count, padded_depth, workspace.panel);
    for (int first = 0; first < layer.depth(); first += kPanel) {
      kernels.panel(layer.out, count, derivative + begin, pixels, 1, workspace.panel.data() + first,
                    padded_depth, workspace.product.data());
      const int valid = std::min(kPanel, layer.depth() - first);
      for (int o = 0; o < layer.out; ++o) {
        float* row = gradient.weights.data() + static_cast<std::size_t>(o) * depth + first;
        const float* product = workspace.product.data() + o * kPanel;
        for (int k = 0; k < valid; ++k) row[k] += product[k];
      }
    }
  }
  for (int o = 0; o < layer.out; ++o) {
    double sum = 0;
    for (int i = 0; i < pixels; ++i) sum += derivative[static_cast<std::ptrdiff_t>(o) * pixels + i];
    gradient.bias[static_cast<std::size_t>(o)] += static_cast<float>(sum);
  }
}

void input_gradient(const Layer& layer, const Padded& source, Shape from, Shape to,
                    const float* derivative, std::vector<float>& result,
                    BackwardWorkspace& workspace) {
  const int pixels = to.height * to.width;
  workspace.padded.assign(static_cast<std::size_t>(from.channels) *
                              static_cast<std::size_t>(source.height) *
                              static_cast<std::size_t>(source.width),
                          0.0F);
  workspace.panel.resize(static_cast<std::size_t>(layer.depth()) * kPanel);
  if (pixels == 1) {
    const auto depth = static_cast<std::size_t>(layer.depth());
    std::fill_n(workspace.panel.begin(), depth, 0.0F);
    for (int o = 0; o < layer.out; ++o) {
      const float* row = layer.weights.data() + static_cast<std::size_t>(o) * depth;
      for (std::size_t k = 0; k < depth; ++k) workspace.panel[k] += derivative[o] * row[k];
    }
    scatter(layer, workspace.panel.data(), 1, to, 0, 1, workspace.padded.data(), source.height,
            source.width);
  }
  for (int begin = 0; begin < pixels && pixels > 1; begin += kPanel) {
    gemm_kernels().panel(layer.depth(), layer.out, layer.weights.data(), 1, layer.depth(),
                         derivative + begin, pixels, workspace.panel.data());
    scatter(layer, workspace.panel.data(), kPanel, to, begin, std::min(kPanel, pixels - begin),
            workspace.padded.data(), source.height, source.width);
  }
  result.assign(from.size() + kPanel, 0.0F);
  for (int c = 0; c < from.channels; ++c) {
    for (int y = 0; y < from.height; ++y) {
      std::memcpy(
          result.data() + (static_cast<std::ptrdiff_t>(c) * from.height + y) * from.width,
          workspace.padded.data() +
              (static_cast<std::ptrdiff_t>(c) * source.height + y + layer.pad_y) * source.width +
              layer.pad_x,
          static_cast<std::size_t>(from.width) * sizeof(float));
    }
  }
}

// The part of a batch that one thread processes.
struct Shard {
  Gradient gradient;
  double loss = 0;
  Example example;
  std::vector<float> derivative;
  Workspace forward;
  BackwardWorkspace backward;
  std::exception_ptr error;
};

template <typename Visit>
void for_parameters(Network& network, const Visit& visit) {
  for (std::size_t i = 0; i < network.layers.size(); ++i) {
    visit(i, true, network.layers[i].weights);
    visit(i, false, network.layers[i].bias);
  }
}

std::vector<float>& part(Gradient& gradient, std::size_t layer, bool weights) {
  return weights ? gradient.layers[layer].weights : gradient.layers[layer].bias;
}

// Adds the gradients of the shards to the first one, in order, and returns the norm of the mean.
double reduce(std::vector<Shard>& shards, Network& network, int batch) {
  double squares = 0;
  for_parameters(network, [&](std::size_t layer, bool weights, std::vector<float>& values) {
    std::vector<float>& sum = part(shards[0].gradient, layer, weights);
    for (std::size_t k = 0; k < values.size(); ++k) {
      float total = sum[k];
      for (std::size_t s = 1; s < shards.size(); ++s)
        total += part(shards[s].gradient, layer, weights)[k];
      sum[k] = total / static_cast<float>(batch);
      squares += static_cast<double>(sum[k]) * sum[k];
    }
  });
  return std::sqrt(squares);
}

void clear(Gradient& gradient) {
  for (auto& layer : gradient.layers) {
    std::fill(layer.weights.begin(), layer.weights.end(), 0.0F);
    std::fill(layer.bias.begin(), layer.bias.end(), 0.0F);
  }
}

struct Adam {
  Gradient mean;
  Gradient square;

  void step(Network& network, Gradient& gradient, double rate, double decay, double scale,
            int number) {
    constexpr float kBeta1 = 0.9F;
    constexpr float kBeta2 = 0.99F;
    const float mean_correction =
        1.0F / (1.0F - static_cast<float>(std::pow(static_cast<double>(kBeta1), number)));
    const float square_correction =
        1.0F / (1.0F - static_cast<float>(std::pow(static_cast<double>(kBeta2), number)));
    for_parameters(network, [&](std::size_t layer, bool weights, std::vector<float>& values) {
      const std::vector<float>& g = part(gradient, layer, weights);
      std::vector<float>& m = part(mean, layer, weights);
      std::vector<float>& v = part(square, layer, weights);
      const float decay_factor = weights ? 1.0F - static_cast<float>(rate * decay) : 1.0F;
      for (std::size_t k = 0; k < values.size(); ++k) {
        const float slope = g[k] * static_cast<float>(scale);
        m[k] = kBeta1 * m[k] + (1 - kBeta1) * slope;
        v[k] = kBeta2 * v[k] + (1 - kBeta2) * slope * slope;
        values[k] = decay_factor * values[k] - static_cast<float>(rate) * m[k] * mean_correction /
                                                   (std::sqrt(v[k] * square_correction) + 1e-8F);
      }
    });
  }
};

double rate_at(const TrainOptions& options, int step) {
  const double warm_up_steps = std::max(1.0, options.warm_up * options.steps);
  if (step < warm_up_steps) return options.rate * (step + 1) / warm_up_steps;
  const double t = (step - warm_up_steps) / std::max(1.0, options.steps - warm_up_steps);
  return options.rate * 0.5 * (1 + std::cos(std::numbers::pi * t));
}

}  // namespace

Gradient zero_gradient(const Network& network) {
  Gradient gradient;
  for (const Layer& layer : network.layers) {
    gradient.layers.push_back({std::vector<float>(layer.weights.size(), 0.0F),
                               std::vector<float>(layer.bias.size(), 0.0F)});
  }
  return gradient;
}

void backward(const Network& network, const Workspace& forward,
              const std::vector<float>& output_gradient, Gradient& gradient,
              BackwardWorkspace& workspace) {
  workspace.output.assign(output_gradient.begin(), output_gradient.end());
  workspace.output.resize(output_gradient.size() + kPanel, 0.0F);
  for (std::size_t i = network.layers.size(); i-- > 0;) {
    const Layer& layer = network.layers[i];
    const Shape from = forward.shapes[i];
    const Shape to = forward.shapes[i + 1];
    if (layer.kind == Layer::Kind::kMaximum) {
      TARSIER_REQUIRE(i > 0, "a network does not begin with a maximum");
      backward_maximum(layer, forward.maps[i - 1].data(), from, to, workspace.output.data(),
                       workspace.input);
    } else {
      if (layer.relu) {
        const std::vector<float>& map = forward.maps[i];
        for (std::size_t k = 0; k < map.size(); ++k)
          workspace.output[k] = map[k] <= 0 ? 0.0F : workspace.output[k];
      }
      const Padded source{forward.padded[i].data(), from.height + 2 * layer.pad_y,
                          from.width + 2 * layer.pad_x};
      weight_gradient(layer, source, to, workspace.output.data(), gradient.layers[i], workspace);
      if (i == 0) return;
      input_gradient(layer, source, from, to, workspace.output.data(), workspace.input, workspace);
    }
    std::swap(workspace.output, workspace.input);
  }
}

void TrainOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(batch >= kShards && batch % kShards == 0 && batch <= 4096,
                  "a batch of {} is not a multiple of {}", batch, kShards);
}

void train(Network& network, const TrainOptions& options, const MakeExample& make, const Loss& loss,
           const Report& report, const std::stop_token& stop) {
  options.check();
  network.check();
  std::vector<Shard> shards(kShards);
  for (Shard& shard : shards) shard.gradient = zero_gradient(network);
  Adam adam{zero_gradient(network), zero_gradient(network)};
  Network averaged = network;
  const Rng base(options.seed);
  const int share = options.batch / kShards;
  double reported = 0;
  int steps_since_report = 0;
  const auto work = [&](int number, int step) {
    Shard& shard = shards[static_cast<std::size_t>(number)];
    try {
      clear(shard.gradient);
      shard.loss = 0;
      for (int k = 0; k < share; ++k) {
        const std::int64_t index =
            static_cast<std::int64_t>(step) * options.batch + number * share + k;
        Rng rng = base.fork(static_cast<std::uint64_t>(index));
        make(index, rng, shard.example);
        const std::vector<float>& output =
            run(network, shard.example.input.data(), shard.example.shape, shard.forward);
        shard.derivative.assign(output.size(), 0.0F);
        shard.loss += loss(shard.example, output, shard.forward.shapes.back(), shard.derivative);
        backward(network, shard.forward, shard.derivative, shard.gradient, shard.backward);
      }
    } catch (...) {
      shard.error = std::current_exception();
    }
  };
  for (int step = 0; step < options.steps; ++step) {
    throw_if_stopped(stop);
    cv::parallel_for_(cv::Range(0, kShards), [&](const cv::Range& range) {
      for (int s = range.start; s < range.end; ++s) work(s, step);
    });
    for (Shard& shard : shards) {
      if (shard.error) std::rethrow_exception(shard.error);
      reported += shard.loss;
    }
    const double norm = reduce(shards, network, options.batch);
    const double scale = norm > options.clip ? options.clip / norm : 1.0;
    adam.step(network, shards[0].gradient, rate_at(options, step), options.weight_decay, scale,
              step + 1);
    // The memory of the mean grows from zero to the last two hundredths of the run.
    const double memory =
        std::min(1 - 1.0 / std::max(2.0, 0.02 * options.steps), (step + 1.0) / (step + 10.0));
    for (std::size_t i = 0; i < network.layers.size(); ++i) {
      const auto blend = [&](std::vector<float>& mean, const std::vector<float>& now) {
        for (std::size_t k = 0; k < mean.size(); ++k)
          mean[k] += static_cast<float>(1 - memory) * (now[k] - mean[k]);
      };
      blend(averaged.layers[i].weights, network.layers[i].weights);
      blend(averaged.layers[i].bias, network.layers[i].bias);
    }
    ++steps_since_report;
    if (report && (steps_since_report == 100 || step + 1 == options.steps)) {
      report(step + 1, reported / (static_cast<double>(steps_since_report) * options.batch));
      reported = 0;
      steps_since_report = 0;
    }
  }
  network = averaged;
}

void train(Network& network, const TrainOptions& options, std::string_view stage,
           const MakeExample& make, const Loss& loss, Progress& progress, std::stop_token stop) {
  progress.begin(stage, options.steps, "steps");
  int done = 0;
  train(
      network, options, make, loss,
      [&](int step, double mean) {
        log_debug("{}: step {} of {}, loss {:.4f}", stage, step, options.steps, mean);
        report_measure(progress, "loss", mean);
        progress.advance(step - done);
        done = step;
      },
      std::move(stop));
  progress.end();
}

}  // namespace tarsier::linalg
