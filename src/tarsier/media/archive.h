// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Model files are JSON: {"type": .., "version": .., "provenance": {..}, "payload": {..}}. Numbers
// are written so that they are read back as the same doubles. Larger arrays are packed (see
// pack/unpack).

struct ArchiveLimits {
  std::int64_t max_bytes = 256'000'000;
  int max_depth = 64;  // nesting of brackets
  // Numbers, texts, lists and objects together. This limits the memory.
  std::int64_t max_values = 5'000'000;
};

struct Archive {
  std::string type;  // "plate-reader", "shape-model" ..
  int version = 1;   // of the payload's layout
  // Object: data, terms, program version, seed, date, measured accuracy.
  nlohmann::json provenance;
  nlohmann::json payload;  // object
};

// Writes atomically; the same content gives the same bytes. Throws OutputError, also for numbers
// that are not finite and text that is not UTF-8 (the message names the place). Throws
// std::invalid_argument for an empty type, a version below 1, or a payload or provenance that is
// not an object.
void write_archive(const std::string& path, const Archive& archive);

// Checks size, nesting depth, number of values and UTF-8 before it parses; then type and version
// (1..newest_version). Throws ModelError that names path and reason.
[[nodiscard]] Archive read_archive(const std::string& path, std::string_view type,
                                   int newest_version, const ArchiveLimits& limits = {});

// Reads an archive of any type and version (`tarsier models list`).
[[nodiscard]] Archive read_any_archive(const std::string& path, const ArchiveLimits& limits = {});

// Parses untrusted JSON text within `limits`. Throws InputError that names `name` and the place.
[[nodiscard]] nlohmann::json parse_json(std::string_view text, const std::string& name,
                                        const ArchiveLimits& limits = {});

// A dense array of numbers, last index fastest. T is double ("f8"), float ("f4"), std::int32_t
// ("i4") or std::uint8_t ("u1").
template <typename T>
struct PackedArray {
  // The product is values.size(); empty for a single number.
  std::vector<std::int64_t> shape;
  std::vector<T> values;
};

// Encodes as {"dtype": "f8", "shape": [2, 3], "data": base64 of the little-endian bytes}. Throws
// std::invalid_argument if the shape does not fit the number of values or a value is not finite.
template <typename T>
[[nodiscard]] nlohmann::json pack(const PackedArray<T>& array);

// The same in half precision ("f2"): 11 significant bits per number, magnitudes from 6e-8 to 65504.
// Throws std::invalid_argument also for larger numbers.
[[nodiscard]] nlohmann::json pack_half(const PackedArray<float>& array);
// Rounds to the nearest half-precision number.
[[nodiscard]] float rounded_to_half(float value);

// The inverse, for untrusted JSON: checks type, shape, size and finiteness. `shape` is the expected
// shape; -1 accepts any size. "f2" is read as float. Throws ModelError(path) that names `what`.
template <typename T>
[[nodiscard]] PackedArray<T> unpack(const nlohmann::json& value, const std::string& path,
                                    std::string_view what,
                                    std::initializer_list<std::int64_t> shape);

// Members of untrusted JSON objects. They throw ModelError(path) that names the member if it is
// missing, of another type, or outside low..high.
[[nodiscard]] const nlohmann::json& member(const nlohmann::json& object, const std::string& name,
                                           const std::string& path);
[[nodiscard]] double number_member(const nlohmann::json& object, const std::string& name,
                                   const std::string& path,
                                   double low = std::numeric_limits<double>::lowest(),
                                   double high = std::numeric_limits<double>::max());
[[nodiscard]] std::int64_t integer_member(const nlohmann::json& object, const std::string& name,
                                          const std::string& path, std::int64_t low,
                                          std::int64_t high);
[[nodiscard]] std::string text_member(const nlohmann::json& object, const std::string& name,
                                      const std::string& path, std::size_t max_bytes = 4096);

// Returns `model` if its check() passes. Converts the exception of check() to ModelError(path).
template <typename Model>
[[nodiscard]] Model checked(Model model, const std::string& path) {
  try {
    model.check();
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
  return model;
}

}  // namespace tarsier
