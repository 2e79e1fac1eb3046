// SPDX-License-Identifier: MIT
#include "tarsier/linalg/tensors.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

namespace tarsier::linalg {
namespace {

using nlohmann::json;

constexpr std::int64_t kMaxManifest = 4'000'000;  // bytes
constexpr std::int64_t kMaxShard = 200'000'000;   // bytes
constexpr std::size_t kMaxTensors = 2000;
constexpr std::size_t kMaxName = 200;  // bytes

static_assert(std::endian::native == std::endian::little, "shards are little-endian");

json parsed_manifest(const std::string& path) {
  const std::string text = read_file(path, kMaxManifest);
  try {
    return parse_json(text, path);
  } catch (const InputError& error) {  // "path: why"
    throw ModelError(path, std::string(error.what()).substr(path.size() + 2));
  }
}

const json& list_member(const json& object, const char* name, const std::string& path,
                        std::size_t max_count) {
  const json& list = member(object, name, path);
  if (!list.is_array() || list.empty() || list.size() > max_count)
    throw ModelError(path, fmt::format("'{}' is not a list of 1 to {}", name, max_count));
  return list;
}

// The groups of a manifest: consecutive tensors in shards.
const json& groups_of(const json& manifest, const std::string& path) {
  if (!manifest.is_array() || manifest.empty() || manifest.size() > 100)
    throw ModelError(path, "is not a weights manifest: a list is expected");
  return manifest;
}

std::vector<std::string> shards_of(const json& group, const std::string& path) {
  std::vector<std::string> names;
  for (const json& item : list_member(group, "paths", path, 100)) {
    const std::string name = item.is_string() ? item.get<std::string>() : "";
    // A shard must be in the folder of its manifest: no other paths are accepted.
    if (name.empty() || name.front() == '.' || name.size() > kMaxName ||
        name.find('/') != std::string::npos || name.find('\0') != std::string::npos)
      throw ModelError(path, "a shard's name is not a file name");
    names.push_back(name);
  }
  return names;
}

std::vector<std::int64_t> shape_of(const json& item, const std::string& name,
                                   const std::string& path, std::size_t& count) {
  std::vector<std::int64_t> shape;
  count = 1;
  for (const json& size : list_member(item, "shape", path, 4)) {
    if (!size.is_number_integer() || size.get<std::int64_t>() < 1 ||
        size.get<std::int64_t>() > 4096)
      throw ModelError(path, fmt::format("'{}': a size that is not 1 to 4096", name));
    shape.push_back(size.get<std::int64_t>());
    count *= static_cast<std::size_t>(shape.back());
    if (count > static_cast<std::size_t>(kMaxShard))
      throw ModelError(path, fmt::format("'{}' is too large", name));
  }
  return shape;
}

NamedTensor tensor_of(const json& item, std::string_view& bytes, const std::string& path) {
  NamedTensor tensor;
  tensor.name = text_member(item, "name", path, kMaxName);
  std::size_t count = 0;
  tensor.shape = shape_of(item, tensor.name, path, count);
  if (text_member(item, "dtype", path) != "float32")
    throw ModelError(path, fmt::format("'{}' is not of float32", tensor.name));
  const bool quantised = item.contains("quantization");
  const std::size_t length = quantised ? count : count * sizeof(float);
  if (bytes.size() < length)
    throw ModelError(path, fmt::format("its shards end within '{}'", tensor.name));
  if (quantised) {
    const json& levels = item["quantization"];
    if (text_member(levels, "dtype", path) != "uint8")
      throw ModelError(path, fmt::format("'{}' is not quantised to uint8", tensor.name));
    tensor.scale = number_member(levels, "scale", path, -1e6, 1e6);
    tensor.min = number_member(levels, "min", path, -1e6, 1e6);
    tensor.levels.assign(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length));
  } else {
    tensor.values.resize(count);
    std::memcpy(tensor.values.data(), bytes.data(), length);
    for (const float value : tensor.values)
      if (!std::isfinite(value))
        throw ModelError(path, fmt::format("'{}' is not finite", tensor.name));
  }
  bytes.remove_prefix(length);
  return tensor;
}

}  // namespace

std::vector<std::string> shards_of_manifest(const std::string& manifest) {
  const json groups = parsed_manifest(manifest);
  std::vector<std::string> names;
  for (const json& group : groups_of(groups, manifest))
    for (std::string& name : shards_of(group, manifest)) names.push_back(std::move(name));
  return names;
}

NamedTensors read_weights_manifest(const std::string& manifest) {
  const json groups = parsed_manifest(manifest);
  const std::filesystem::path folder = std::filesystem::path(manifest).parent_path();
  NamedTensors weights;
  for (const json& group : groups_of(groups, manifest)) {
    std::string bytes;
    for (const std::string& name : shards_of(group, manifest)) {
      bytes += read_file((folder / name).string(), kMaxShard);
      if (bytes.size() > static_cast<std::size_t>(kMaxShard))
        throw ModelError(manifest, "its shards are too large");
    }
    std::string_view rest = bytes;
    for (const json& item : list_member(group, "weights", manifest, kMaxTensors)) {
      weights.push_back(tensor_of(item, rest, manifest));
      if (weights.size() > kMaxTensors) throw ModelError(manifest, "too many tensors");
    }
    if (!rest.empty())
      throw ModelError(manifest, fmt::format("its shards hold {} bytes too many", rest.size()));
  }
  return weights;
}

json tensors_to_json(const NamedTensors& tensors) {
  json list = json::array();
  for (const NamedTensor& tensor : tensors) {
    json item = {{"name", tensor.name}};
    if (tensor.levels.empty()) {
      item["numbers"] = pack(PackedArray<float>{tensor.shape, tensor.values});
    } else {
      item["scale"] = tensor.scale;
      item["min"] = tensor.min;
      item["levels"] = pack(PackedArray<std::uint8_t>{tensor.shape, tensor.levels});
    }
    list.push_back(std::move(item));
  }
  return list;
}

NamedTensors tensors_from_json(const json& payload, const char* name, const std::string& path) {
  NamedTensors tensors;
  for (const json& item : list_member(payload, name, path, kMaxTensors)) {
    NamedTensor tensor;
    tensor.name = text_member(item, "name", path, kMaxName);
    const bool quantised = item.contains("levels");
    const json& packed = member(item, quantised ? "levels" : "numbers", path);
    const json& shape = list_member(packed, "shape", path, 4);
    // unpack() checks the numbers, given the number of dimensions.
    const auto unpacked = [&]<typename T>(std::vector<T>& into) {
      PackedArray<T> array;
      switch (shape.size()) {
        case 1:
          array = unpack<T>(packed, path, tensor.name, {-1});
          break;
        case 2:
          array = unpack<T>(packed, path, tensor.name, {-1, -1});
          break;
        case 3:
          array = unpack<T>(packed, path, tensor.name, {-1, -1, -1});
          break;
        default:
          array = unpack<T>(packed, path, tensor.name, {-1, -1, -1, -1});
          break;
      }
      tensor.shape = std::move(array.shape);
      into = std::move(array.values);
    };
    if (quantised) {
      tensor.scale = number_member(item, "scale", path, -1e6, 1e6);
      tensor.min = number_member(item, "min", path, -1e6, 1e6);
      unpacked(tensor.levels);
    } else {
      unpacked(tensor.values);
    }
    tensors.push_back(std::move(tensor));
  }
  return tensors;
}

TensorReader::TensorReader(const NamedTensors& tensors, std::string path) : path_(std::move(path)) {
  for (const NamedTensor& tensor : tensors) by_name_.emplace(tensor.name, &tensor);
  if (by_name_.size() != tensors.size()) throw ModelError(path_, "two tensors have the same name");
}

std::vector<float> TensorReader::take(const std::string& name, std::size_t dimensions,
                                      std::vector<std::int64_t>& shape) {
  const auto found = by_name_.find(name);
  if (found == by_name_.end()) throw ModelError(path_, fmt::format("'{}' is missing", name));
  const NamedTensor& tensor = *found->second;
  shape = tensor.shape;
  if (shape.size() != dimensions)
    throw ModelError(path_,
                     fmt::format("'{}' has {} dimensions, not {}", name, shape.size(), dimensions));
  std::size_t count = 1;
  for (const std::int64_t size : shape) {
    if (size < 1 || size > 4096) throw ModelError(path_, fmt::format("'{}': its size", name));
    count *= static_cast<std::size_t>(size);
    if (count > 100'000'000) throw ModelError(path_, fmt::format("'{}' is too large", name));
  }
  std::vector<float> out = tensor.values;
  if (!tensor.levels.empty()) {
    out.resize(tensor.levels.size());
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] = static_cast<float>(tensor.scale * tensor.levels[i] + tensor.min);
  }
  if (out.size() != count)
    throw ModelError(path_, fmt::format("'{}' has {} numbers, not {}", name, out.size(), count));
  for (const float value : out)
    if (!std::isfinite(value)) throw ModelError(path_, fmt::format("'{}' is not finite", name));
  ++used_;
  return out;
}

std::vector<float> TensorReader::take_vector(const std::string& name, int length) {
  std::vector<std::int64_t> shape;
  std::vector<float> values = take(name, 1, shape);
  if (shape[0] != length)
    throw ModelError(path_, fmt::format("'{}' has {} numbers, not {}", name, shape[0], length));
  return values;
}

}  // namespace tarsier::linalg
