// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/deep.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <stdexcept>
#include <string_view>

namespace tarsier::face::recognition {
namespace {

// Mean colour of the network's training faces: red, green, blue.
constexpr std::array<float, 3> kMeanRgb{122.782F, 117.001F, 104.298F};
constexpr int kMaxOutputs = 1024;

// Merges the convolution with the scale after it: s (w x + b) + t = (s w) x + (s b + t).
linalg::Layer layer_of(linalg::TensorReader& tensors, const std::string& prefix, int stride,
                       bool relu) {
  std::vector<std::int64_t> shape;
  const std::vector<float> filters = tensors.take(prefix + "/conv/filters", 4, shape);
  if (shape[0] != shape[1] || shape[0] > 7 || shape[0] % 2 == 0)
    throw ModelError(tensors.path(),
                     fmt::format("'{}': filters of {} x {}", prefix, shape[0], shape[1]));
  const int kernel = static_cast<int>(shape[0]);
  linalg::Layer layer = linalg::convolution(static_cast<int>(shape[2]), static_cast<int>(shape[3]),
                                            kernel, kernel, relu);
  layer.stride = stride;
  if (stride > 1) layer.pad_x = layer.pad_y = 0;
  const std::vector<float> bias = tensors.take_vector(prefix + "/conv/bias", layer.out);
  const std::vector<float> scale = tensors.take_vector(prefix + "/scale/weights", layer.out);
  const std::vector<float> shift = tensors.take_vector(prefix + "/scale/biases", layer.out);
  const auto out = static_cast<std::size_t>(layer.out);
  const auto in = static_cast<std::size_t>(layer.in);
  const auto window = static_cast<std::size_t>(kernel) * static_cast<std::size_t>(kernel);
  for (std::size_t tap = 0; tap < window; ++tap)
    for (std::size_t i = 0; i < in; ++i)
      for (std::size_t o = 0; o < out; ++o)
        layer.weights[(o * in + i) * window + tap] = scale[o] * filters[(tap * in + i) * out + o];
  for (std::size_t o = 0; o < out; ++o) layer.bias[o] = scale[o] * bias[o] + shift[o];
  return layer;
}

std::int64_t fingerprint_of(const linalg::ResidualNetwork& network) {
  std::uint64_t hash = 0xCBF29CE484222325ULL;  // FNV-1a of 32-bit words
  const auto add = [&](const linalg::Layer& layer) {
    for (const std::vector<float>* numbers : {&layer.weights, &layer.bias})
      for (const float number : *numbers) {
        hash ^= std::bit_cast<std::uint32_t>(number);
        hash *= 0x100000001B3ULL;
      }
  };
  add(network.stem);
  for (const linalg::ResidualBlock& block : network.blocks) {
    add(block.first);
    add(block.second);
  }
  add(network.head);
  return static_cast<std::int64_t>(std::max<std::uint64_t>(1, hash >> 1));
}

}  // namespace

DeepNetwork build_deep_network(const DeepWeights& weights, const std::string& path) {
  constexpr std::string_view kStem = "/conv/filters";
  constexpr std::string_view kBlock = "/conv1/conv/filters";
  linalg::TensorReader tensors(weights, path);
  DeepNetwork out;
  bool stem = false;
  for (const DeepTensor& tensor : weights) {
    const std::string& name = tensor.name;
    if (name.ends_with(kBlock)) {
      const std::string block = name.substr(0, name.size() - kBlock.size());
      const int stride = block.find("_down") == std::string::npos ? 1 : 2;
      linalg::ResidualBlock layers;
      layers.first = layer_of(tensors, block + "/conv1", stride, true);
      layers.second = layer_of(tensors, block + "/conv2", 1, false);
      out.network.blocks.push_back(std::move(layers));
    } else if (name.ends_with(kStem) && std::count(name.begin(), name.end(), '/') == 2) {
      if (stem) throw ModelError(path, fmt::format("'{}': a second first layer", name));
      stem = true;
      out.network.stem = layer_of(tensors, name.substr(0, name.size() - kStem.size()), 2, true);
    }
  }
  if (!stem) throw ModelError(path, "the first layer is missing");
  std::vector<std::int64_t> shape;
  const std::vector<float> matrix = tensors.take("fc", 2, shape);
  if (shape[1] > kMaxOutputs) throw ModelError(path, fmt::format("{} outputs", shape[1]));
  linalg::Layer head =
      linalg::convolution(static_cast<int>(shape[0]), static_cast<int>(shape[1]), 1, 1, false);
  for (std::size_t i = 0; i < static_cast<std::size_t>(head.in); ++i)
    for (std::size_t o = 0; o < static_cast<std::size_t>(head.out); ++o)
      head.weights[o * static_cast<std::size_t>(head.in) + i] =
          matrix[i * static_cast<std::size_t>(head.out) + o];
  out.network.head = std::move(head);
  if (!tensors.all_used()) throw ModelError(path, "holds tensors that belong to no layer");
  try {
    out.network.check();
    TARSIER_REQUIRE(out.network.stem.in == 3, "{} channels in place of three colours",
                    out.network.stem.in);
    (void)out.network.cost({3, kChipSize, kChipSize});
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
  out.fingerprint = fingerprint_of(out.network);
  return out;
}

cv::Mat chip_of_crop(const cv::Mat& crop) {
  require_gray(crop);
  constexpr double kEyeLine = 46.3;  // px below the upper edge of a chip
  constexpr double kEyeX = 0.27;     // position of the eyes in the crop
  constexpr double kEyeY = 0.34;
  constexpr double kAspect = 1.25;  // height / width of the crop
  cv::Mat source;                   // never the crop's own pixels: the caller still uses them
  const double scale = kChipEyeDistance / ((1 - 2 * kEyeX) * crop.cols);
  // Also for crops with another aspect.
  const double scale_y = scale * kAspect * crop.cols / crop.rows;
  if (scale < 0.6)
    cv::GaussianBlur(crop, source, {}, 0.4 / scale, 0.4 / scale_y);
  else
    source = crop;
  // Pixel centres are at integers.
  const double left = kEyeX * crop.cols - 0.5;
  const double line = kEyeY * crop.rows - 0.5;
  const cv::Mat map =
      (cv::Mat_<double>(2, 3) << scale, 0, (kChipSize - kChipEyeDistance) / 2 - 0.5 - scale * left,
       0, scale_y, kEyeLine - 0.5 - scale_y * line);
  cv::Mat chip;
  cv::warpAffine(source, chip, map, {kChipSize, kChipSize}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  cv::cvtColor(chip, chip, cv::COLOR_GRAY2BGR);
  return chip;
}

std::vector<float> embed(const DeepNetwork& network, const cv::Mat& chip) {
  TARSIER_REQUIRE(chip.type() == CV_8UC3 && chip.cols == kChipSize && chip.rows == kChipSize,
                  "a chip is CV_8UC3 of {} x {} px", kChipSize, kChipSize);
  TARSIER_REQUIRE(network.embedder == nullptr, "an embedder takes faces, not chips");
  constexpr std::size_t kPlane = static_cast<std::size_t>(kChipSize) * kChipSize;
  thread_local std::vector<float> planes;  // avoids allocating megabytes for each face
  thread_local linalg::ResidualWorkspace workspace;
  planes.resize(3 * kPlane);
  for (int y = 0; y < kChipSize; ++y) {
    const auto* row = chip.ptr<unsigned char>(y);
    float* out = planes.data() + static_cast<std::ptrdiff_t>(y) * kChipSize;
    for (int x = 0; x < kChipSize; ++x)
      for (std::size_t c = 0; c < 3; ++c)
        out[c * kPlane + static_cast<std::size_t>(x)] =
            (static_cast<float>(row[3 * x + 2 - static_cast<int>(c)]) - kMeanRgb[c]) / 255.0F;
  }
  return linalg::run(network.network, planes.data(), {3, kChipSize, kChipSize}, workspace);
}

std::vector<float> embed_crop(const DeepNetwork& network, const cv::Mat& crop) {
  return network.embedder ? network.embedder->embed(crop) : embed(network, chip_of_crop(crop));
}

}  // namespace tarsier::face::recognition
