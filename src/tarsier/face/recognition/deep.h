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

// Face embeddings by a deep residual network: embeddings of one person are similar under different
// light, pose and age. The network is dlib's (King, "High quality face recognition with deep metric
// learning", 2017; 99.38 % of the pairs of LFW), as distributed in the npm package
// @vladmandic/face-api. It is not part of the program: see scripts/get-model.sh.
namespace tarsier::face::recognition {

// Side of the network's input image (chip), px.
inline constexpr int kChipSize = 150;
inline constexpr double kChipEyeDistance = 53;  // px between the centres of the eyes

using DeepTensor = linalg::NamedTensor;
using DeepWeights = linalg::NamedTensors;
using linalg::read_weights_manifest;
using linalg::shards_of_manifest;

// The user's own embedding network, which runs elsewhere (face/onnx).
class FaceEmbedder {
 public:
  virtual ~FaceEmbedder() = default;
  // The embedding of a face, cropped as in people/eyes.h; CV_8UC1 of any size. Thread-safe. Throws
  // ModelError if the network fails.
  [[nodiscard]] virtual std::vector<float> embed(const cv::Mat& crop) const = 0;
  [[nodiscard]] virtual int outputs() const = 0;
};

struct DeepNetwork {
  linalg::ResidualNetwork network;
  std::shared_ptr<const FaceEmbedder> embedder;  // used instead of `network`, if not null
  std::string name;                              // of an embedder's file; otherwise empty
  std::string sha256;                            // of this file, hexadecimal; otherwise empty
  // > 0; of the weights. Embeddings of networks with different fingerprints cannot be compared.
  std::int64_t fingerprint = 0;
  [[nodiscard]] int outputs() const { return embedder ? embedder->outputs() : network.outputs(); }
};

// Builds the network from tensors with the names of face-api, in their order:
//   S/conv/filters (7 x 7 x 3 x n), S/conv/bias, S/scale/weights, S/scale/biases: the stem
//   B/conv1/.., B/conv2/.. (3 x 3): a block; stride 2 if B contains "_down"
//   fc (channels x outputs)
// Each layer is a convolution, then y = weight * x + bias for each channel. Throws ModelError(path)
// if the tensors do not form a network that takes a chip.
[[nodiscard]] DeepNetwork build_deep_network(const DeepWeights& weights, const std::string& path);

// Files of type "face-embedding". Throws ModelError(path), OutputError.
void write_deep_weights(const std::string& path, const DeepWeights& weights,
                        const nlohmann::json& provenance);
[[nodiscard]] DeepNetwork read_deep_network(const std::string& path);

// The chip of a face that is cropped as in people/eyes.h (CV_8UC1 of any size, the eyes at 0.27 and
// 0.73 of the width, 0.34 of the height). The result is CV_8UC3 with the eyes kChipEyeDistance px
// apart, as in the training of dlib's network. Missing parts at the sides are filled by replicating
// the border.
[[nodiscard]] cv::Mat chip_of_crop(const cv::Mat& crop);

// The embedding of a chip, CV_8UC3 (BGR) of kChipSize x kChipSize. Not normalised. Thread-safe.
// Throws std::invalid_argument.
[[nodiscard]] std::vector<float> embed(const DeepNetwork& network, const cv::Mat& chip);

// The embedding of a face that is cropped as in people/eyes.h (CV_8UC1), computed from its chip or
// by the embedder.
[[nodiscard]] std::vector<float> embed_crop(const DeepNetwork& network, const cv::Mat& crop);

}  // namespace tarsier::face::recognition
