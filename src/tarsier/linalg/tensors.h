// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// Named arrays of numbers: network weights trained by other programs, as stored by tensorflow.js
// and in Tarsier's model files.
namespace tarsier::linalg {

// An array of `shape`, last index fastest. It has either one byte per number, with the value scale
// * level + min, or floating-point `values`.
struct NamedTensor {
  std::string name;
  std::vector<std::int64_t> shape;
  std::vector<std::uint8_t> levels;  // or
  std::vector<float> values;
  double scale = 1;
  double min = 0;
};
using NamedTensors = std::vector<NamedTensor>;

// Reads a weights manifest of tensorflow.js and its shards in the same folder. Throws ModelError,
// InputError.
[[nodiscard]] NamedTensors read_weights_manifest(const std::string& manifest);
// The shards that a manifest names: file names without paths. Throws ModelError.
[[nodiscard]] std::vector<std::string> shards_of_manifest(const std::string& manifest);

// Convert to and from a list in model files. from_json throws ModelError(path).
[[nodiscard]] nlohmann::json tensors_to_json(const NamedTensors& tensors);
[[nodiscard]] NamedTensors tensors_from_json(const nlohmann::json& payload, const char* name,
                                             const std::string& path);

// Returns tensors by name and checks them. Errors are ModelError(path).
class TensorReader {
 public:
  // `tensors` must outlive it.
  TensorReader(const NamedTensors& tensors, std::string path);
  // The numbers of a tensor with this number of dimensions, and its shape. Numbers are finite,
  // indices at most 4096.
  [[nodiscard]] std::vector<float> take(const std::string& name, std::size_t dimensions,
                                        std::vector<std::int64_t>& shape);
  // A tensor with one dimension of this length.
  [[nodiscard]] std::vector<float> take_vector(const std::string& name, int length);
  [[nodiscard]] bool has(const std::string& name) const { return by_name_.contains(name); }
  [[nodiscard]] bool all_used() const { return used_ == by_name_.size(); }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::map<std::string, const NamedTensor*> by_name_;
  std::size_t used_ = 0;
};

}  // namespace tarsier::linalg
