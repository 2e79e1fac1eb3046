// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// Small convolutional networks for one CPU: chains of convolutions and pooling, in single
// precision, for maps of any size. Inference and training (trainer.h) are implemented here, without
// other tools.
//
// A map is `channels` planes of height x width, dense, plane by plane in row-major order.
namespace tarsier::linalg {

struct Shape {
  int channels = 0;
  int height = 0;
  int width = 0;
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(channels) * static_cast<std::size_t>(height) *
           static_cast<std::size_t>(width);
  }
  bool operator==(const Shape&) const = default;
};

// A convolution (strictly, a correlation: LeCun et al., "Gradient-based learning applied to
// document recognition", 1998):
//   out[o][y][x] = act(bias[o] + sum w[o][i][v][u] in[i][y stride + v dilation - pad_y][...])
// with zeros outside; or the maximum over kernel_y x kernel_x, whose stride is its kernel.
struct Layer {
  enum class Kind { kConvolution, kMaximum };
  Kind kind = Kind::kConvolution;
  int in = 1;        // channels; 1..4096
  int out = 1;       // channels; for kMaximum the same as `in`
  int kernel_y = 3;  // 1..64
  int kernel_x = 3;
  int stride = 1;    // 1..8
  int dilation = 1;  // 1..8
  int pad_y = 1;     // 0..64, at most half the kernel's extent, rounded up
  int pad_x = 1;
  bool relu = true;            // act(x) = max(0, x), else x
  std::vector<float> weights;  // out x in x kernel_y x kernel_x
  std::vector<float> bias;     // out

  [[nodiscard]] int depth() const { return in * kernel_y * kernel_x; }
  // Throws std::invalid_argument if the output would be empty.
  [[nodiscard]] Shape output(const Shape& input) const;
};

[[nodiscard]] Layer convolution(int in, int out, int kernel_y, int kernel_x, bool relu = true);
[[nodiscard]] Layer maximum(int channels, int kernel_y, int kernel_x);

struct Network {
  std::vector<Layer> layers;

  [[nodiscard]] Shape output(Shape input) const;
  [[nodiscard]] std::size_t parameters() const;
  // Number of multiplications of one pass.
  [[nodiscard]] double cost(Shape input) const;
  // Throws std::invalid_argument if adjacent layers do not match or an array has a wrong size.
  void check() const;
};

// Normal distribution with variance 2 / fan-in (He et al., ICCV 2015), a tenth of that for the last
// layer; biases 0.
void initialize(Network& network, Rng& rng);

// Rounds weights and biases to half precision.
void round_to_half(Network& network);

// Buffers of a pass, reused from call to call; use one for each thread.
struct Workspace {
  std::vector<std::vector<float>> maps;    // output of each layer, dense
  std::vector<std::vector<float>> padded;  // input of each convolution with its zero padding
  std::vector<Shape> shapes;               // input, then output of each layer
  std::vector<float> columns;
  std::vector<float> panel;
  std::vector<std::ptrdiff_t> offsets;
};

// Runs the network on `input` (shape.size() numbers). The result is in workspace.maps.back(), of
// shape workspace.shapes.back(). With `parallel`, large maps use OpenCV's threads; the result does
// not change.
const std::vector<float>& run(const Network& network, const float* input, Shape shape,
                              Workspace& workspace, bool parallel = false);

enum class Precision { kSingle, kHalf };
// For model files. Half precision halves the size and is lossless after round_to_half().
// network_from_json reads both. It throws ModelError(path) for malformed, oversized or non-finite
// data.
[[nodiscard]] nlohmann::json network_to_json(const Network& network,
                                             Precision precision = Precision::kSingle);
[[nodiscard]] Network network_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::linalg
