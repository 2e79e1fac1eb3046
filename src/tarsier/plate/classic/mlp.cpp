// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/mlp.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <algorithm>
#include <cmath>

namespace tarsier::plate {
namespace {

// out (rows x units) = tanh(in (rows x width) . weights^T), weights with a bias column.
void forward(const std::vector<float>& in, int rows, int width, const std::vector<float>& weights,
             int units, std::vector<float>& out) {
  out.resize(static_cast<std::size_t>(rows) * static_cast<std::size_t>(units));
  for (int r = 0; r < rows; ++r) {
    const float* x = in.data() + static_cast<std::ptrdiff_t>(r) * width;
    for (int u = 0; u < units; ++u) {
      const float* w = weights.data() + static_cast<std::ptrdiff_t>(u) * (width + 1);
      float sum = w[width];
      for (int k = 0; k < width; ++k) sum += w[k] * x[k];
      out[static_cast<std::size_t>(r) * static_cast<std::size_t>(units) +
          static_cast<std::size_t>(u)] = std::tanh(sum);
    }
  }
}

// gradient (units x (width + 1)) += delta^T . [in 1]
void add_gradient(const std::vector<float>& delta, const std::vector<float>& in, int rows,
                  int width, int units, std::vector<float>& gradient) {
  for (int r = 0; r < rows; ++r) {
    const float* x = in.data() + static_cast<std::ptrdiff_t>(r) * width;
    for (int u = 0; u < units; ++u) {
      const float d = delta[static_cast<std::size_t>(r) * static_cast<std::size_t>(units) +
                            static_cast<std::size_t>(u)];
      float* g = gradient.data() + static_cast<std::ptrdiff_t>(u) * (width + 1);
      for (int k = 0; k < width; ++k) g[k] += d * x[k];
      g[width] += d;
    }
  }
}

// Each weight has its own step size, which grows while its gradient keeps its sign.
struct Rprop {
  std::vector<float> steps;
  std::vector<float> previous;

  explicit Rprop(std::size_t count) : steps(count, 0.02F), previous(count, 0.0F) {}
  void update(std::vector<float>& weights, std::vector<float>& gradient) {
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const float product = gradient[i] * previous[i];
      if (product > 0) {
        steps[i] = std::min(steps[i] * 1.2F, 5.0F);
      } else if (product < 0) {
        steps[i] = std::max(steps[i] * 0.5F, 1e-6F);
        gradient[i] = 0;
      }
      if (gradient[i] > 0) weights[i] -= steps[i];
      if (gradient[i] < 0) weights[i] += steps[i];
      previous[i] = gradient[i];
    }
  }
};

}  // namespace

std::vector<float> Mlp::run(const float* x) const {
  std::vector<float> in(static_cast<std::size_t>(inputs));
  for (std::size_t k = 0; k < in.size(); ++k) in[k] = (x[k] - mean[k]) / scale[k];
  std::vector<float> hidden_values;
  std::vector<float> out;
  forward(in, 1, inputs, hidden_weights, hidden, hidden_values);
  forward(hidden_values, 1, hidden, output_weights, outputs, out);
  return out;
}

Mlp train_mlp(const cv::Mat& rows, const std::vector<int>& labels, int outputs,
              const MlpOptions& options, Rng rng, const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(
      rows.type() == CV_32F && rows.rows > 0 && rows.rows == static_cast<int>(labels.size()),
      "{} rows, {} labels", rows.rows, labels.size());
  Mlp net;
  net.inputs = rows.cols;
  net.hidden = options.hidden;
  net.outputs = outputs;
  const auto width = static_cast<std::size_t>(rows.cols);
  net.mean.assign(width, 0);
  net.scale.assign(width, 0);
  for (std::size_t k = 0; k < width; ++k) {
    double sum = 0;
    double squares = 0;
    for (int r = 0; r < rows.rows; ++r) {
      const auto v = static_cast<double>(rows.at<float>(r, static_cast<int>(k)));
      sum += v;
      squares += v * v;
    }
    const double mean = sum / rows.rows;
    net.mean[k] = static_cast<float>(mean);
    net.scale[k] =
        static_cast<float>(std::sqrt(std::max(0.0, squares / rows.rows - mean * mean)) + 1e-3);
  }
  std::vector<float> in(static_cast<std::size_t>(rows.rows) * width);
  for (int r = 0; r < rows.rows; ++r)
    for (std::size_t k = 0; k < width; ++k)
      in[static_cast<std::size_t>(r) * width + k] =
          (rows.at<float>(r, static_cast<int>(k)) - net.mean[k]) / net.scale[k];
  const auto fill = [&](std::vector<float>& weights, int units, int fan) {
    weights.resize(static_cast<std::size_t>(units) * static_cast<std::size_t>(fan + 1));
    for (float& w : weights) w = static_cast<float>(rng.normal(0, 0.7 / std::sqrt(fan)));
  };
  fill(net.hidden_weights, net.hidden, net.inputs);
  fill(net.output_weights, net.outputs, net.hidden);
  Rprop hidden_update(net.hidden_weights.size());
  Rprop output_update(net.output_weights.size());
  std::vector<float> hidden_values;
  std::vector<float> out;
  std::vector<float> delta_out;
  std::vector<float> delta_hidden;
  for (int round = 0; round < options.iterations; ++round) {
    throw_if_stopped(stop);
    forward(in, rows.rows, net.inputs, net.hidden_weights, net.hidden, hidden_values);
    forward(hidden_values, rows.rows, net.hidden, net.output_weights, net.outputs, out);
    delta_out.resize(out.size());
    for (int r = 0; r < rows.rows; ++r) {
      for (int o = 0; o < outputs; ++o) {
        const std::size_t i = static_cast<std::size_t>(r) * static_cast<std::size_t>(outputs) +
                              static_cast<std::size_t>(o);
        const float target = labels[static_cast<std::size_t>(r)] == o ? 0.95F : -0.95F;
        delta_out[i] = (out[i] - target) * (1 - out[i] * out[i]);
      }
    }
    delta_hidden.assign(hidden_values.size(), 0.0F);
    for (int r = 0; r < rows.rows; ++r) {
      float* d = delta_hidden.data() + static_cast<std::ptrdiff_t>(r) * net.hidden;
      for (int o = 0; o < outputs; ++o) {
        const float up = delta_out[static_cast<std::size_t>(r) * static_cast<std::size_t>(outputs) +
                                   static_cast<std::size_t>(o)];
        const float* w =
            net.output_weights.data() + static_cast<std::ptrdiff_t>(o) * (net.hidden + 1);
        for (int h = 0; h < net.hidden; ++h) d[h] += up * w[h];
      }
      const float* m = hidden_values.data() + static_cast<std::ptrdiff_t>(r) * net.hidden;
      for (int h = 0; h < net.hidden; ++h) d[h] *= 1 - m[h] * m[h];
    }
    std::vector<float> hidden_gradient(net.hidden_weights.size(), 0.0F);
    std::vector<float> output_gradient(net.output_weights.size(), 0.0F);
    add_gradient(delta_hidden, in, rows.rows, net.inputs, net.hidden, hidden_gradient);
    add_gradient(delta_out, hidden_values, rows.rows, net.hidden, net.outputs, output_gradient);
    hidden_update.update(net.hidden_weights, hidden_gradient);
    output_update.update(net.output_weights, output_gradient);
  }
  return net;
}

}  // namespace tarsier::plate
