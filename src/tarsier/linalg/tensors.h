// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// Named arrays of numbers: the weights of networks that other programs trained, as
// tensorflow.js stores them and as our model files keep them.
namespace tarsier::linalg {

// `shape` with the last index fastest; one byte a number, each scale * level + min, or numbers as
// they are.
struct NamedTensor {
  std::string name;
  std::vector<std::int64_t> shape;
  std::vector<std::uint8_t> levels;  // or
  std::vector<float> values;
  double scale = 1;
  double min = 0;
};
using NamedTensors = std::vector<NamedTensor>;

// Reads a weights manifest of tensorflow.js and its shards, which lie beside it. Throws
// ModelError, InputError.
[[nodiscard]] NamedTensors read_weights_manifest(const std::string& manifest);
// The shards that a manifest names: file names, no paths. Throws ModelError.
[[nodiscard]] std::vector<std::string> shards_of_manifest(const std::string& manifest);

// For model files: a list. from_json throws ModelError(path).
[[nodiscard]] nlohmann::json tensors_to_json(const NamedTensors& tensors);
[[nodiscard]] NamedTensors tensors_from_json(const nlohmann::json& payload, const char* name,
                                             const std::string& path);

// Hands out tensors by name and checks them. What it throws is ModelError(path).
class TensorReader {
 public:
  // `tensors` must outlive it.
  TensorReader(const NamedTensors& tensors, std::string path);
  // The numbers of a tensor of so many dimensions, and its shape; finite, at most 4096 an index.
  [[nodiscard]] std::vector<float> take(const std::string& name, std::size_t dimensions,
                                        std::vector<std::int64_t>& shape);
  // Of one dimension and this length.
  [[nodiscard]] std::vector<float> take_vector(const std::string& name, int length);
  [[nodiscard]] bool has(const std::string& name) const { return by_name_.contains(name); }
  [[nodiscard]] bool all_taken() const { return taken_ == by_name_.size(); }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::map<std::string, const NamedTensor*> by_name_;
  std::size_t taken_ = 0;
};

}  // namespace tarsier::linalg
