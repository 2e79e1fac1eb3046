// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/linalg/network.h"

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string_view>
#include <vector>

namespace tarsier::linalg {

// Gradient of a loss with respect to every parameter, in the layout of the network.
struct Gradient {
  struct LayerGradient {
    std::vector<float> weights;
    std::vector<float> bias;
  };
  std::vector<LayerGradient> layers;
};

[[nodiscard]] Gradient zero_gradient(const Network& network);

// Buffers of the backward pass.
struct BackwardWorkspace {
  std::vector<float> output;  // gradient with respect to a layer's output
  std::vector<float> input;
  std::vector<float> padded;
  std::vector<float> columns;
  std::vector<float> panel;
  std::vector<float> product;
};

// Call after run(). Adds the gradient of a loss to `gradient`; `output_gradient` is the derivative
// of the loss with respect to the network's output (Rumelhart, Hinton and Williams, 1986).
void backward(const Network& network, const Workspace& forward,
              const std::vector<float>& output_gradient, Gradient& gradient,
              BackwardWorkspace& workspace);

// One training example: the network's input, and the target of the loss.
struct Example {
  Shape shape;
  std::vector<float> input;
  std::vector<float> target;  // whatever the loss needs
};

struct TrainOptions {
  int steps = 1000;            // batches
  int batch = 32;              // examples; a multiple of kShards
  double rate = 2e-3;          // peak rate of Adam
  double warm_up = 0.02;       // share of the steps with a rising rate
  double weight_decay = 1e-4;  // decoupled (Loshchilov and Hutter, 2019)
  double clip = 5;             // maximum norm of the gradient
  std::uint64_t seed = 1;
  int threads = 0;  // 0: all cores; does not change the result

  [[nodiscard]] OptionFields fields() {
    return {{"steps", steps, range(1, 10'000'000)},
            {"rate", rate, above(0, 1)},
            {"warm_up", warm_up, range_below(0, 1)},
            {"weight_decay", weight_decay, range(0, 1)},
            {"clip", clip, above(0)},
            {"threads", threads, at_least(0)}};
  }
  void check() const;
};

// A batch is always summed in this many parts, so that the result does not depend on the number of
// threads.
inline constexpr int kShards = 4;

// Makes example number `index` of the endless stream, from its own `rng`.
using MakeExample = std::function<void(std::int64_t index, Rng& rng, Example& example)>;
// Returns the loss of an output and writes its derivative.
using Loss = std::function<double(const Example& example, const std::vector<float>& output,
                                  Shape shape, std::vector<float>& derivative)>;
// Called at intervals with the step and the mean loss since the last call.
using Report = std::function<void(int step, double loss)>;

// Adam (Kingma and Ba, ICLR 2015) with a cosine decay of the rate to zero. The returned weights are
// an exponential moving average over the last steps (Polyak and Juditsky, 1992). Throws Interrupted
// if `stop` is requested.
void train(Network& network, const TrainOptions& options, const MakeExample& make, const Loss& loss,
           const Report& report, const std::stop_token& stop);

// The same, reported as a stage of `progress`.
void train(Network& network, const TrainOptions& options, std::string_view stage,
           const MakeExample& make, const Loss& loss, Progress& progress, std::stop_token stop);

}  // namespace tarsier::linalg
