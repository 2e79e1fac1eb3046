// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/ply_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>

namespace tarsier::sfm {
namespace {

static_assert(std::endian::native == std::endian::little,
              "numbers are read in their memory layout");

constexpr std::size_t kMaxLineBytes = 1000;

template <typename T>
double as_number(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return static_cast<double>(value);
}

PlyType find_type(std::string_view name) {
  if (name == "char" || name == "int8") return {1, as_number<std::int8_t>};
  if (name == "uchar" || name == "uint8") return {1, as_number<std::uint8_t>};
  if (name == "short" || name == "int16") return {2, as_number<std::int16_t>};
  if (name == "ushort" || name == "uint16") return {2, as_number<std::uint16_t>};
  if (name == "int" || name == "int32") return {4, as_number<std::int32_t>};
  if (name == "uint" || name == "uint32") return {4, as_number<std::uint32_t>};
  if (name == "float" || name == "float32") return {4, as_number<float>};
  if (name == "double" || name == "float64") return {8, as_number<double>};
  return {};
}

void add_property(PlyElement& element, std::string_view rest, const std::string& path) {
  const auto next_type = [&] {
    const std::string_view name = next_word(rest);
    const PlyType type = find_type(name);
    if (!type.is_known())
      throw InputError(path, fmt::format("has a property of unknown type '{}'", name));
    return type;
  };
  PlyProperty property;
  std::string_view after = rest;
  if (next_word(after) == "list") {
    rest = after;
    property.count = next_type();
  }
  property.type = next_type();
  property.name = next_word(rest);
  property.offset = element.bytes;
  if (!property.is_list()) element.bytes += property.type.bytes;
  element.properties.push_back(std::move(property));
}

}  // namespace

bool PlyElement::has_lists() const {
  return std::any_of(properties.begin(), properties.end(),
                     [](const PlyProperty& property) { return property.is_list(); });
}

const PlyProperty* PlyElement::find(std::string_view property) const {
  for (const PlyProperty& one : properties)
    if (one.name == property) return &one;
  return nullptr;
}

std::vector<PlyElement> read_ply_header(std::istream& stream, const std::string& path) {
  std::vector<PlyElement> elements;
  std::string line;
  std::array<char, kMaxLineBytes + 1> buffer{};
  const auto next = [&] {
    // Fails where the line is longer than the buffer.
    if (!stream.getline(buffer.data(), buffer.size()))
      throw InputError(path, "is not a PLY file, or its header is truncated");
    line.assign(buffer.data(), static_cast<std::size_t>(stream.gcount()) - (stream.eof() ? 0 : 1));
    if (!line.empty() && line.back() == '\r') line.pop_back();
  };
  next();
  if (line != "ply") throw InputError(path, "is not a PLY file");
  for (int lines = 0; line != "end_header"; ++lines) {
    if (lines > 200) throw InputError(path, "has a header of more than 200 lines");
    next();
    std::string_view rest = line;
    const std::string_view first = next_word(rest);
    if (first == "format" && next_word(rest) != "binary_little_endian")
      throw InputError(path, "is not a binary little-endian PLY file: convert it to this format");
    if (first == "element") {
      PlyElement element;
      element.name = next_word(rest);
      const auto count = to_integer(next_word(rest), 0, std::numeric_limits<int>::max());
      if (!count)
        throw InputError(
            path, fmt::format("has no valid number of elements '{}' in its header", element.name));
      element.count = *count;
      elements.push_back(std::move(element));
    }
    if (first == "property") {
      if (elements.empty()) throw InputError(path, "has a property before its first element");
      add_property(elements.back(), rest, path);
    }
  }
  if (elements.empty() || elements[0].name != "vertex")
    throw InputError(path, "does not begin with element 'vertex', and cannot be read");
  if (elements[0].has_lists())
    throw InputError(path, "has list properties in element 'vertex', and cannot be read");
  return elements;
}

}  // namespace tarsier::sfm
