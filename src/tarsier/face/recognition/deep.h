// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/residual.h"
#include "tarsier/linalg/tensors.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// A face as the numbers that a deep residual network makes of it: near each other for images of one
// person, whatever the light, the pose and the age. The network is dlib's (King, "High quality face
// recognition with deep metric learning", 2017; 99.38 % of the pairs of LFW), as the npm package
// @vladmandic/face-api carries it. It does not come with the program: see scripts/get-model.sh.
namespace tarsier::face::recognition {

// Side of the image that the network sees, px: a chip.
inline constexpr int kChipSize = 150;
inline constexpr double kChipEyes = 53;  // px between the centres of the eyes

using DeepTensor = linalg::NamedTensor;
using DeepWeights = linalg::NamedTensors;
using linalg::read_weights_manifest;
using linalg::shards_of_manifest;

// What a network of the user's own makes of a face: code that runs elsewhere (face/onnx).
class FaceEmbedder {
 public:
  virtual ~FaceEmbedder() = default;
  // The numbers of a face that is cut as people/eyes.h cuts it, CV_8UC1 of any size. Any number of
  // threads may call it. Throws ModelError where the network fails.
  [[nodiscard]] virtual std::vector<float> embed(const cv::Mat& crop) const = 0;
  [[nodiscard]] virtual int outputs() const = 0;
};

struct DeepNetwork {
  linalg::ResidualNetwork network;
  std::shared_ptr<const FaceEmbedder> embedder;  // in place of `network`; or null
  std::string name;                              // of an embedder's file; else empty
  std::string sha256;                            // of this file, hexadecimal; else empty
  std::int64_t fingerprint = 0;  // > 0; of the weights: what two networks make does not compare
  [[nodiscard]] int outputs() const { return embedder ? embedder->outputs() : network.outputs(); }
};

// Builds the network from tensors named as face-api does, in their order:
//   S/conv/filters (7 x 7 x 3 x n), S/conv/bias, S/scale/weights, S/scale/biases: the stem
//   B/conv1/.., B/conv2/.. (3 x 3): a block, of stride 2 where B holds "_down"
//   fc (channels x outputs)
// conv, then y = weight * x + bias for each channel. Throws ModelError(path) for what does not make
// a network that takes a chip.
[[nodiscard]] DeepNetwork build_deep_network(const DeepWeights& weights, const std::string& path);

// Files of type "face-embedding". Throw ModelError(path), OutputError.
void write_deep_weights(const std::string& path, const DeepWeights& weights,
                        const nlohmann::json& provenance);
[[nodiscard]] DeepNetwork read_deep_network(const std::string& path);

// The chip of a face that is cut as people/eyes.h cuts it (CV_8UC1 of any size, the eyes at 0.27 and
// 0.73 of the width, 0.34 of the height): CV_8UC3, the eyes kChipEyes px apart as dlib's network
// learned them; what the cut lacks at the sides is its edge repeated.
[[nodiscard]] cv::Mat chip_of_crop(const cv::Mat& crop);

// The network's numbers for a chip, CV_8UC3 (BGR) of kChipSize x kChipSize. Not of a stated length.
// Any number of threads may call it. Throws std::invalid_argument.
[[nodiscard]] std::vector<float> embed(const DeepNetwork& network, const cv::Mat& chip);

// The numbers of a face that is cut as people/eyes.h cuts it (CV_8UC1): of its chip, or the
// embedder's.
[[nodiscard]] std::vector<float> embed_crop(const DeepNetwork& network, const cv::Mat& crop);

}  // namespace tarsier::face::recognition
