// SPDX-License-Identifier: MIT
#include "tarsier/core/cpu.h"
#include "tarsier/core/errors.h"
#include "tarsier/linalg/gemm.h"
#include "tarsier/linalg/losses.h"
#include "tarsier/linalg/network.h"
#include "tarsier/linalg/testing_noise.h"
#include "tarsier/linalg/trainer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::linalg {
namespace {

// Every kind of layer, odd sizes, stride, dilation, uneven padding.
Network small_network(Rng& rng) {
  Network network;
  network.layers = {convolution(2, 5, 3, 3), maximum(5, 2, 2), convolution(5, 7, 3, 5),
                    convolution(7, 4, 3, 3), convolution(4, 3, 1, 1, false)};
  network.layers[0].stride = 2;
  network.layers[3].dilation = 2;
  network.layers[3].pad_y = 2;
  network.layers[3].pad_x = 1;
  initialize(network, rng);
  for (Layer& layer : network.layers)
    for (float& bias : layer.bias) bias = static_cast<float>(rng.normal(0.1, 0.1));
  return network;
}

class Gemm : public testing::TestWithParam<const GemmKernels* (*)()> {};

TEST_P(Gemm, AgreesWithTheDefinition) {
  const GemmKernels* kernels = GetParam()();
  if (kernels == nullptr) GTEST_SKIP() << "not on this processor's kind";
  if ((GetParam() == gemm_avx2 && hardware_simd_level() < SimdLevel::kAvx2) ||
      (GetParam() == gemm_avx512 && hardware_simd_level() < SimdLevel::kAvx512))
    GTEST_SKIP() << "not on this processor";
  Rng rng(3);
  for (const int rows : {1, 3, 8, 13}) {
    for (const int depth : {1, 7, 40}) {
      const std::vector<float> a = noise(static_cast<std::size_t>(rows * depth), rng);
      const std::vector<float> b = noise(static_cast<std::size_t>(depth + 5) * 60, rng);
      std::vector<float> out(static_cast<std::size_t>(rows) * kPanel, 9.0F);
      kernels->panel(rows, depth, a.data(), depth, 1, b.data(), 60, out.data());
      std::vector<std::ptrdiff_t> offsets;
      for (int k = 0; k < depth; ++k) offsets.push_back((depth - 1 - k) * 60 + k % 3);
      std::vector<float> scattered(out.size(), 9.0F);
      kernels->panel_at(rows, depth, a.data(), b.data(), offsets.data(), scattered.data());
      std::vector<float> sums(static_cast<std::size_t>(rows) * 5, 1.0F);
      kernels->dots(rows, 5, depth, a.data(), depth, b.data(), 60, sums.data(), 5);
      for (int m = 0; m < rows; ++m) {
        for (int n = 0; n < kPanel; ++n) {
          double expected = 0;
          for (int k = 0; k < depth; ++k)
            expected += static_cast<double>(a[static_cast<std::size_t>(m * depth + k)]) *
                        b[static_cast<std::size_t>(k * 60 + n)];
          ASSERT_NEAR(out[static_cast<std::size_t>(m * kPanel + n)], expected, 1e-4);
          expected = 0;
          for (int k = 0; k < depth; ++k) {
            expected += static_cast<double>(a[static_cast<std::size_t>(m * depth + k)]) *
                        b[static_cast<std::size_t>(offsets[static_cast<std::size_t>(k)] + n)];
          }
          ASSERT_NEAR(scattered[static_cast<std::size_t>(m * kPanel + n)], expected, 1e-4);
        }
        for (int n = 0; n < 5; ++n) {
          double expected = 1;
          for (int k = 0; k < depth; ++k)
            expected += static_cast<double>(a[static_cast<std::size_t>(m * depth + k)]) *
                        b[static_cast<std::size_t>(n * 60 + k)];
          ASSERT_NEAR(sums[static_cast<std::size_t>(m * 5 + n)], expected, 1e-4);
        }
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Levels, Gemm, testing::Values(&gemm_baseline, &gemm_avx2, &gemm_avx512));

// With a stride of 1, windows are read in place; others are gathered. Rows are shorter and longer
// than a panel.
struct ConvolutionForm {
  int stride;
  Shape shape;
};
class Convolution : public testing::TestWithParam<ConvolutionForm> {};

TEST_P(Convolution, AgreesWithItsEquation) {
  const auto& [stride, shape] = GetParam();
  Rng rng(5);
  Layer layer = convolution(3, 4, 3, 5);
  layer.stride = stride;
  layer.dilation = 2;
  layer.relu = false;
  layer.weights = noise(layer.weights.size(), rng);
  layer.bias = noise(layer.bias.size(), rng);
  const Network network{{layer}};
  const std::vector<float> input = noise(shape.size(), rng);
  Workspace workspace;
  // First a larger map: its values must not remain in the buffers.
  const Shape larger{3, 40, 60};
  (void)run(network, noise(larger.size(), rng).data(), larger, workspace);
  const std::vector<float>& output = run(network, input.data(), shape, workspace);
  const Shape to = workspace.shapes.back();
  ASSERT_EQ(to, network.output(shape));
  std::size_t at = 0;
  for (int o = 0; o < to.channels; ++o) {
    for (int y = 0; y < to.height; ++y) {
      for (int x = 0; x < to.width; ++x) {
        double expected = layer.bias[static_cast<std::size_t>(o)];
        for (int i = 0; i < 3; ++i) {
          for (int v = 0; v < 3; ++v) {
            for (int u = 0; u < 5; ++u) {
              const int yy = y * stride + v * 2 - layer.pad_y;
              const int xx = x * stride + u * 2 - layer.pad_x;
              if (yy < 0 || yy >= shape.height || xx < 0 || xx >= shape.width) continue;
              expected +=
                  static_cast<double>(
                      layer.weights[static_cast<std::size_t>(((o * 3 + i) * 3 + v) * 5 + u)]) *
                  input[static_cast<std::size_t>((i * shape.height + yy) * shape.width + xx)];
            }
          }
        }
        ASSERT_NEAR(output[at++], expected, 1e-4);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Forms, Convolution,
                         testing::Values(ConvolutionForm{2, {3, 13, 31}},
                                         ConvolutionForm{1, {3, 13, 31}},
                                         ConvolutionForm{1, {3, 7, 9}},
                                         ConvolutionForm{1, {3, 9, 120}}));

TEST(Losses, TheDerivativeOfAMapAgreesWithFiniteDifferences) {
  // A cell with an object and known values, one without values, one empty cell, and one ignored
  // cell.
  const Shape shape{3, 2, 2};
  const std::vector<float> target = {1, 1, 0, kIgnoredCell, 1, 0, 0, 0, 0.2F,
                                     0, 0, 0, -0.7F,        0, 0, 0};
  const std::vector<float> output = {0.4F, -1, -30, 2, 0.25F, 3, 3, 3, 0.1F, 3, 3, 3};
  const MapLoss form{.values = 2, .weight = 2, .focal = 1.5F, .huber_delta = 0.1F};
  std::vector<float> derivative(output.size(), 0.0F);
  (void)map_loss(form, target, output, shape, derivative);
  for (std::size_t i = 0; i < output.size(); ++i) {
    constexpr float kStep = 1e-3F;
    std::vector<float> moved = output;
    std::vector<float> unused(output.size(), 0.0F);
    moved[i] += kStep;
    const double above = map_loss(form, target, moved, shape, unused);
    moved[i] -= 2 * kStep;
    const double below = map_loss(form, target, moved, shape, unused);
    EXPECT_NEAR(derivative[i], (above - below) / (2 * static_cast<double>(kStep)), 2e-3) << i;
  }
  EXPECT_EQ(derivative[3], 0.0F);  // ignored
  EXPECT_EQ(derivative[5], 0.0F);  // unknown values
}

TEST(Network, ResultDoesNotDependOnThreads) {
  Rng rng(6);
  const Network network = small_network(rng);
  const Shape shape{2, 150, 170};
  const std::vector<float> input = noise(shape.size(), rng);
  Workspace one;
  Workspace many;
  EXPECT_EQ(run(network, input.data(), shape, one, false),
            run(network, input.data(), shape, many, true));
}

class Backward : public testing::TestWithParam<Shape> {};

// The second shape ends in a map of one pixel.
INSTANTIATE_TEST_SUITE_P(Shapes, Backward, testing::Values(Shape{2, 21, 26}, Shape{2, 12, 14}));

TEST_P(Backward, AgreesWithFiniteDifferences) {
  Rng rng(7);
  Network network = small_network(rng);
  const Shape shape = GetParam();
  if (shape.height == 12) {
    network.layers[3].pad_y = network.layers[3].pad_x = 0;
    network.layers[3].dilation = 1;
  }
  const std::vector<float> input = noise(shape.size(), rng);
  Workspace workspace;
  const std::vector<float> first = run(network, input.data(), shape, workspace);
  const std::vector<float> slope = noise(first.size(), rng);  // loss = slope . output
  Gradient gradient = zero_gradient(network);
  BackwardWorkspace back;
  backward(network, workspace, slope, gradient, back);
  const auto loss = [&] {
    Workspace scratch;
    const std::vector<float>& output = run(network, input.data(), shape, scratch);
    double sum = 0;
    for (std::size_t i = 0; i < output.size(); ++i)
      sum += static_cast<double>(output[i]) * slope[i];
    return sum;
  };
  for (std::size_t l = 0; l < network.layers.size(); ++l) {
    for (const bool weights : {true, false}) {
      auto& values = weights ? network.layers[l].weights : network.layers[l].bias;
      const auto& analytic = weights ? gradient.layers[l].weights : gradient.layers[l].bias;
      for (std::size_t k = 0; k < values.size(); k += 1 + values.size() / 9) {
        constexpr float kStep = 1e-3F;
        const float original = values[k];
        values[k] = original + kStep;
        const double up = loss();
        values[k] = original - kStep;
        const double down = loss();
        values[k] = original;
        const double numeric = (up - down) / (2.0 * static_cast<double>(kStep));
        EXPECT_NEAR(analytic[k], numeric, 0.02 * (1 + std::abs(numeric)))
            << "layer " << l << ", parameter " << k;
      }
    }
  }
}

// Decides which of two stripes of a noisy image is brighter.
void make_stripes(std::int64_t, Rng& rng, Example& example) {
  example.shape = {1, 8, 8};
  example.input.assign(64, 0);
  const int brighter = rng.integer(0, 1);
  for (std::size_t i = 0; i < 64; ++i)
    example.input[i] = static_cast<float>(rng.normal((i % 8 < 4) == (brighter == 0) ? 1 : 0, 0.5));
  example.target = {brighter == 0 ? 1.0F : -1.0F};
}

double logistic_loss(const Example& example, const std::vector<float>& output, Shape,
                     std::vector<float>& derivative) {
  const double margin = static_cast<double>(example.target[0]) * output[0];
  derivative[0] = static_cast<float>(-example.target[0] / (1 + std::exp(margin)));
  return std::log1p(std::exp(-margin));
}

Network stripes_network() {
  Network network;
  network.layers = {convolution(1, 4, 3, 3), maximum(4, 2, 2), convolution(4, 1, 4, 4, false)};
  network.layers[2].pad_y = network.layers[2].pad_x = 0;
  Rng rng(1);
  initialize(network, rng);
  return network;
}

TEST(Train, IsDeterministicForAnyNumberOfThreads) {
  TrainOptions options;
  options.steps = 60;
  options.batch = 16;
  options.rate = 0.01;
  std::vector<double> losses;
  Network one = stripes_network();
  train(one, options, make_stripes, logistic_loss,
        [&](int, double loss) { losses.push_back(loss); }, {});
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  Network two = stripes_network();
  train(two, options, make_stripes, logistic_loss, nullptr, {});
  cv::setNumThreads(threads);
  for (std::size_t i = 0; i < one.layers.size(); ++i)
    EXPECT_EQ(one.layers[i].weights, two.layers[i].weights);
  Rng rng(77);
  int right = 0;
  Workspace workspace;
  for (int i = 0; i < 200; ++i) {
    Example example;
    make_stripes(i, rng, example);
    right += run(one, example.input.data(), example.shape, workspace)[0] * example.target[0] > 0;
  }
  EXPECT_GE(right, 195);
}

TEST(Train, CanBeStopped) {
  std::stop_source stop;
  stop.request_stop();
  Network network = stripes_network();
  EXPECT_THROW(train(network, {}, make_stripes, logistic_loss, nullptr, stop.get_token()),
               Interrupted);
}

TEST(NetworkFile, RoundTrip) {
  Rng rng(8);
  const Network network = small_network(rng);
  const Network again = network_from_json(network_to_json(network), "a.json");
  const Shape shape{2, 21, 26};
  const std::vector<float> input = noise(shape.size(), rng);
  Workspace a;
  Workspace b;
  EXPECT_EQ(run(network, input.data(), shape, a), run(again, input.data(), shape, b));
}

TEST(NetworkFile, IsHalfAsLargeInHalfPrecision) {
  Rng rng(8);
  Network network = small_network(rng);
  const Network original_network = network;
  round_to_half(network);
  EXPECT_NE(network.layers[0].weights, original_network.layers[0].weights);
  const nlohmann::json written = network_to_json(network, Precision::kHalf);
  EXPECT_LT(10 * written.dump().size(), 6 * network_to_json(network).dump().size());
  const Network again = network_from_json(written, "a.json");
  for (std::size_t l = 0; l < network.layers.size(); ++l) {
    EXPECT_EQ(again.layers[l].weights, network.layers[l].weights);
    EXPECT_EQ(again.layers[l].bias, network.layers[l].bias);
    for (std::size_t i = 0; i < network.layers[l].weights.size(); ++i)
      EXPECT_NEAR(network.layers[l].weights[i], original_network.layers[l].weights[i],
                  1e-7 + std::abs(original_network.layers[l].weights[i]) / 2048);
  }
}

TEST(NetworkFile, RefusesInconsistentFiles) {
  Rng rng(9);
  const nlohmann::json good = network_to_json(small_network(rng));
  const auto broken = [&](auto change) {
    nlohmann::json value = good;
    change(value["layers"]);
    EXPECT_THROW((void)network_from_json(value, "a.json"), ModelError) << value["layers"][0].dump();
  };
  broken([](nlohmann::json& layers) { layers[0]["pad_y"] = 3; });
  broken([](nlohmann::json& layers) { layers[0]["in"] = 3; });
  broken([](nlohmann::json& layers) { layers[2]["out"] = 1 << 20; });
  broken([](nlohmann::json& layers) { layers[0]["stride"] = 0; });
  broken([](nlohmann::json& layers) { layers[0]["kind"] = "magic"; });
  broken([](nlohmann::json& layers) { layers[0].erase("bias"); });
  broken([](nlohmann::json& layers) {
    layers.erase(1);
    layers.erase(1);
  });
  broken([](nlohmann::json& layers) { layers = nlohmann::json::array(); });
}

TEST(Network, RefusesAMapThatIsTooSmall) {
  Rng rng(1);
  const Network network = small_network(rng);
  Workspace workspace;
  const std::vector<float> input(8, 0.0F);
  EXPECT_THROW((void)run(network, input.data(), Shape{2, 2, 2}, workspace), std::invalid_argument);
  EXPECT_THROW((void)run(network, input.data(), Shape{1, 4, 2}, workspace), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::linalg
