// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/linalg/network.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::linalg {

void round_to_half(Network& network) {
  for (Layer& layer : network.layers) {
    for (float& weight : layer.weights) weight = rounded_to_half(weight);
    for (float& bias : layer.bias) bias = rounded_to_half(bias);
  }
}

nlohmann::json network_to_json(const Network& network, Precision precision) {
  network.check();
  const auto packed = [&](std::vector<std::int64_t> shape, const std::vector<float>& values) {
    const PackedArray<float> array{std::move(shape), values};
    return precision == Precision::kHalf ? pack_half(array) : pack(array);
  };
  nlohmann::json layers = nlohmann::json::array();
  for (const Layer& layer : network.layers) {
    nlohmann::json value{{"kind", layer.kind == Layer::Kind::kMaximum ? "maximum" : "convolution"},
                         {"in", layer.in},
                         {"out", layer.out},
                         {"kernel_y", layer.kernel_y},
                         {"kernel_x", layer.kernel_x}};
    if (layer.kind == Layer::Kind::kConvolution) {
      value["stride"] = layer.stride;
      value["dilation"] = layer.dilation;
      value["pad_y"] = layer.pad_y;
      value["pad_x"] = layer.pad_x;
      value["relu"] = layer.relu ? 1 : 0;
      value["weights"] =
          packed({layer.out, layer.in, layer.kernel_y, layer.kernel_x}, layer.weights);
      value["bias"] = packed({layer.out}, layer.bias);
    }
    layers.push_back(std::move(value));
  }
  return {{"layers", std::move(layers)}};
}

Network network_from_json(const nlohmann::json& value, const std::string& path) {
  const nlohmann::json& layers = member(value, "layers", path);
  if (!layers.is_array() || layers.empty() || layers.size() > 64)
    throw ModelError(path, "layers: a list of 1 to 64 is expected");
  Network network;
  for (const nlohmann::json& item : layers) {
    const auto number = [&](const char* name, int low, int high) {
      return static_cast<int>(integer_member(item, name, path, low, high));
    };
    const std::string kind = text_member(item, "kind", path);
    const int in = number("in", 1, 4096);
    const int out = number("out", 1, 4096);
    const int kernel_y = number("kernel_y", 1, 64);
    const int kernel_x = number("kernel_x", 1, 64);
    if (kind == "maximum") {
      network.layers.push_back(maximum(in, kernel_y, kernel_x));
      network.layers.back().out = out;
      continue;
    }
    if (kind != "convolution")
      throw ModelError(path, fmt::format("kind: \"{}\" is not a kind of layer", kind));
    Layer layer;
    layer.in = in;
    layer.out = out;
    layer.kernel_y = kernel_y;
    layer.kernel_x = kernel_x;
    layer.stride = number("stride", 1, 8);
    layer.dilation = number("dilation", 1, 8);
    layer.pad_y = number("pad_y", 0, 64);
    layer.pad_x = number("pad_x", 0, 64);
    layer.relu = number("relu", 0, 1) == 1;
    layer.weights =
        unpack<float>(member(item, "weights", path), path, "weights", {out, in, kernel_y, kernel_x})
            .values;
    layer.bias = unpack<float>(member(item, "bias", path), path, "bias", {out}).values;
    network.layers.push_back(std::move(layer));
  }
  return checked(std::move(network), path);
}

}  // namespace tarsier::linalg
