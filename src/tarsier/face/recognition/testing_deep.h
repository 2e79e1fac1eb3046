// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/face/recognition/deep.h"

#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

// An untrained deep network: random weights, all kinds of layers, a few thousand numbers.
namespace tarsier::face::recognition {

inline constexpr int kTinyOutputs = 128;

inline DeepWeights tiny_deep_weights(std::uint64_t seed) {
  Rng rng(seed);
  DeepWeights weights;
  const auto levels = [&](const std::string& name, std::vector<std::int64_t> shape, double low,
                          double high) {
    DeepTensor tensor;
    tensor.name = name;
    std::size_t count = 1;
    for (const std::int64_t size : shape) count *= static_cast<std::size_t>(size);
    tensor.shape = std::move(shape);
    tensor.min = low;
    tensor.scale = (high - low) / 255;
    for (std::size_t i = 0; i < count; ++i)
      tensor.levels.push_back(static_cast<std::uint8_t>(rng.uniform(0, 255.99)));
    weights.push_back(std::move(tensor));
  };
  const auto layer = [&](const std::string& name, int kernel, int in, int out) {
    const double reach = std::sqrt(6.0 / (kernel * kernel * in));
    levels(name + "/conv/filters", {kernel, kernel, in, out}, -reach, reach);
    levels(name + "/conv/bias", {out}, -0.1, 0.1);
    levels(name + "/scale/weights", {out}, 0.8, 1.2);
    levels(name + "/scale/biases", {out}, -0.1, 0.1);
  };
  const auto block = [&](const std::string& name, int in, int out) {
    layer(name + "/conv1", 3, in, out);
    layer(name + "/conv2", 3, out, out);
  };
  layer("conv4_down", 7, 3, 4);
  block("conv4_1", 4, 4);
  block("conv8_down", 4, 8);
  block("conv16_down", 8, 16);
  block("conv16_down_out", 16, 16);
  DeepTensor head;
  head.name = "fc";
  head.shape = {16, kTinyOutputs};
  for (int i = 0; i < 16 * kTinyOutputs; ++i)
    head.values.push_back(static_cast<float>(rng.normal(0, 0.3)));
  weights.push_back(std::move(head));
  return weights;
}

// Writes folder/tiny-weights_manifest.json and folder/tiny.bin, as tensorflow.js does.
inline void write_manifest_of(const DeepWeights& weights, const std::string& folder) {
  nlohmann::json list = nlohmann::json::array();
  std::ofstream shard(folder + "/tiny.bin", std::ios::binary);
  for (const DeepTensor& tensor : weights) {
    nlohmann::json item = {{"name", tensor.name}, {"shape", tensor.shape}, {"dtype", "float32"}};
    if (!tensor.levels.empty()) {
      item["quantization"] = {{"dtype", "uint8"}, {"scale", tensor.scale}, {"min", tensor.min}};
      for (const std::uint8_t level : tensor.levels) shard.put(static_cast<char>(level));
    } else {
      std::vector<char> bytes(tensor.values.size() * sizeof(float));
      std::memcpy(bytes.data(), tensor.values.data(), bytes.size());
      shard.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    }
    list.push_back(std::move(item));
  }
  std::ofstream(folder + "/tiny-weights_manifest.json")
      << nlohmann::json::array({{{"weights", list}, {"paths", {"tiny.bin"}}}}).dump();
}

}  // namespace tarsier::face::recognition
