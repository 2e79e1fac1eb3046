// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// Tiny ONNX files for tests, like those of tests/e2e/tiny_onnx.py.
namespace tarsier::face::onnx::testing_onnx {

inline std::string varint(std::uint64_t value) {
  std::string out;
  for (; value > 127; value >>= 7) out += static_cast<char>((value & 127) | 128);
  return out + static_cast<char>(value);
}
inline std::string field(int number, std::uint64_t value) {
  return varint(static_cast<std::uint64_t>(number) << 3) + varint(value);
}
inline std::string field(int number, const std::string& bytes) {
  return varint(static_cast<std::uint64_t>(number) << 3 | 2) + varint(bytes.size()) + bytes;
}

inline std::string tensor(const std::string& name, const std::vector<std::uint64_t>& shape,
                          const std::vector<float>& numbers) {
  std::string out;
  for (const std::uint64_t side : shape) out += field(1, side);
  std::string raw(numbers.size() * sizeof(float), '\0');
  if (!raw.empty()) std::memcpy(raw.data(), numbers.data(), raw.size());
  return out + field(2, 1) + field(8, name) + field(9, raw);
}

inline std::string node(const std::string& kind, const std::vector<std::string>& inputs,
                        const std::string& output, const std::string& attributes = {}) {
  std::string out;
  for (const std::string& input : inputs) out += field(1, input);
  return out + field(2, output) + field(3, "node_" + output) + field(4, kind) + attributes;
}

// A list of integers.
inline std::string attribute(const std::string& name, const std::vector<std::uint64_t>& numbers) {
  std::string out = field(1, name);
  for (const std::uint64_t number : numbers) out += field(8, number);
  return field(5, out + field(20, 7));
}

inline std::string form(const std::string& name, const std::vector<std::uint64_t>& shape) {
  std::string sides;
  for (const std::uint64_t side : shape) sides += field(1, field(1, side));
  return field(1, name) + field(2, field(1, field(1, 1) + field(2, sides)));
}

inline std::string network(const std::vector<std::string>& nodes,
                           const std::vector<std::string>& tensors,
                           const std::vector<std::string>& inputs,
                           const std::vector<std::string>& outputs) {
  std::string graph;
  for (const std::string& one : nodes) graph += field(1, one);
  for (const std::string& one : tensors) graph += field(5, one);
  for (const std::string& one : inputs) graph += field(11, one);
  for (const std::string& one : outputs) graph += field(12, one);
  return field(1, 7) + field(2, "test") + field(7, graph) + field(8, field(2, 11));
}

// The mean of each of 4 x 4 fields of a 1 x 16 x 16 image, as 16 numbers.
inline std::string means_of_fields() {
  return network({node("AveragePool", {"data"}, "small",
                       attribute("kernel_shape", {4, 4}) + attribute("strides", {4, 4})),
                  node("Flatten", {"small"}, "numbers")},
                 {}, {form("data", {1, 1, 16, 16})}, {form("numbers", {1, 16})});
}

}  // namespace tarsier::face::onnx::testing_onnx
