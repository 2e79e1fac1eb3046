// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/deep.h"
#include "tarsier/media/archive.h"

#include <nlohmann/json.hpp>

namespace tarsier::face::recognition {
namespace {

constexpr const char* kEmbeddingType = "face-embedding";
constexpr int kEmbeddingVersion = 1;

}  // namespace

void write_deep_weights(const std::string& path, const DeepWeights& weights,
                        const nlohmann::json& provenance) {
  write_archive(path, {kEmbeddingType,
                       kEmbeddingVersion,
                       provenance,
                       {{"tensors", linalg::tensors_to_json(weights)}}});
}

DeepNetwork read_deep_network(const std::string& path) {
  const Archive archive = read_archive(path, kEmbeddingType, kEmbeddingVersion);
  return build_deep_network(linalg::tensors_from_json(archive.payload, "tensors", path), path);
}

}  // namespace tarsier::face::recognition
