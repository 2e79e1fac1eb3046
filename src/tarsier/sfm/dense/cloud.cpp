// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/cloud.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <string_view>

namespace tarsier::sfm {
namespace {

static_assert(std::endian::native == std::endian::little,
              "points are written as they lie in memory");

constexpr std::size_t kHeaderBytes = 320;
constexpr std::size_t kPointBytes = 6 * 4 + 3 + 4;

// Of one length, whatever the count: the comment takes up the rest.
std::string header_of(std::int64_t count) {
  const std::string start = "ply\nformat binary_little_endian 1.0\ncomment Tarsier";
  const std::string end = fmt::format(
      "\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float confidence\nend_header\n",
      count);
  return start + std::string(kHeaderBytes - start.size() - end.size(), ' ') + end;
}

bool is_finite(const cv::Vec3f& v) {
  return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
}

// Where the numbers of a point are in a record of a file, and of which type.
struct Property {
  std::string name;
  std::string type;
  std::size_t offset = 0;
};

std::size_t bytes_of(std::string_view type) {
  if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
  if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
  if (type == "int" || type == "uint" || type == "float" || type == "int32" || type == "uint32" ||
      type == "float32")
    return 4;
  if (type == "double" || type == "float64") return 8;
  return 0;
}

struct Layout {
  std::vector<Property> properties;
  std::size_t stride = 0;
  std::int64_t count = 0;
};

Layout read_header(std::ifstream& stream, const std::string& path) {
  Layout layout;
  std::string line;
  const auto next = [&] {
    if (!std::getline(stream, line) || line.size() > 1000)
      throw InputError(path, "is no PLY file: its header is cut short");
    if (!line.empty() && line.back() == '\r') line.pop_back();
  };
  next();
  if (line != "ply") throw InputError(path, "is no PLY file");
  bool is_vertex = false;
  for (int lines = 0; line != "end_header"; ++lines) {
    if (lines > 200) throw InputError(path, "has a header of more than 200 lines");
    next();
    std::string_view rest = line;
    const std::string_view first = next_word(rest);
    if (first == "format" && next_word(rest) != "binary_little_endian")
      throw InputError(path, "is no binary little endian PLY file; others are not read");
    if (first == "element") {
      is_vertex = next_word(rest) == "vertex";
      if (is_vertex) {
        const auto count = to_integer(next_word(rest), 0, std::numeric_limits<int>::max());
        if (!count) throw InputError(path, "has no number of points in its header");
        layout.count = *count;
      } else if (layout.properties.empty()) {
        throw InputError(path, "has other elements before its points, and is not read");
      }
    }
    if (first == "property" && is_vertex) {
      const std::string type(next_word(rest));
      const std::size_t bytes = bytes_of(type);
      if (bytes == 0) throw InputError(path, fmt::format("has points with a '{}'", type));
      layout.properties.push_back({std::string(next_word(rest)), type, layout.stride});
      layout.stride += bytes;
    }
  }
  return layout;
}

template <typename T>
float as_float(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return static_cast<float>(value);
}

float number_at(const char* record, const Property& property) {
  const char* bytes = record + property.offset;
  const std::string& type = property.type;
  if (type == "float" || type == "float32") return as_float<float>(bytes);
  if (type == "double" || type == "float64") return as_float<double>(bytes);
  if (type == "uchar" || type == "uint8") return as_float<std::uint8_t>(bytes);
  if (type == "char" || type == "int8") return as_float<std::int8_t>(bytes);
  if (type == "ushort" || type == "uint16") return as_float<std::uint16_t>(bytes);
  if (type == "short" || type == "int16") return as_float<std::int16_t>(bytes);
  if (type == "uint" || type == "uint32") return as_float<std::uint32_t>(bytes);
  return as_float<std::int32_t>(bytes);
}

}  // namespace

CloudWriter::CloudWriter(const std::string& path)
    : path_(path), file_(path), stream_(file_.path(), std::ios::binary) {
  const std::string header = header_of(0);
  stream_.write(header.data(), static_cast<std::streamsize>(header.size()));
  check();
}

void CloudWriter::check() const {
  if (!stream_) throw OutputError(path_, "cannot write (is the disk full?)");
}

void CloudWriter::add(std::span<const CloudPoint> points) {
  std::string bytes;
  bytes.reserve(points.size() * kPointBytes);
  for (const CloudPoint& point : points) {
    TARSIER_REQUIRE(
        is_finite(point.position) && is_finite(point.normal) && std::isfinite(point.confidence),
        "point {}", count_);
    bytes.append(reinterpret_cast<const char*>(point.position.val), 12);
    bytes.append(reinterpret_cast<const char*>(point.normal.val), 12);
    for (int k = 2; k >= 0; --k) bytes.push_back(static_cast<char>(point.color[k]));
    bytes.append(reinterpret_cast<const char*>(&point.confidence), 4);
  }
  count_ += static_cast<std::int64_t>(points.size());
  stream_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  check();
}

void CloudWriter::commit() {
  stream_.seekp(0);
  const std::string header = header_of(count_);
  stream_.write(header.data(), static_cast<std::streamsize>(header.size()));
  stream_.close();
  check();
  file_.commit();
}

std::vector<CloudPoint> read_cloud(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(path, "cannot be read");
  const Layout layout = read_header(stream, path);
  const auto place_of = [&](std::string_view name) -> const Property* {
    for (const Property& property : layout.properties)
      if (property.name == name) return &property;
    return nullptr;
  };
  const std::array<const Property*, 10> at{
      place_of("x"),  place_of("y"),    place_of("z"),     place_of("nx"),  place_of("ny"),
      place_of("nz"), place_of("blue"), place_of("green"), place_of("red"), place_of("confidence")};
  if (at[0] == nullptr || at[1] == nullptr || at[2] == nullptr)
    throw InputError(path, "has no points with x, y and z");
  std::vector<CloudPoint> points;
  std::vector<char> record(layout.stride);
  for (std::int64_t i = 0; i < layout.count; ++i) {
    if (!stream.read(record.data(), static_cast<std::streamsize>(record.size())))
      throw InputError(path, fmt::format("ends after {} of {} points", i, layout.count));
    const auto number = [&](std::size_t k, float otherwise) {
      return at[k] == nullptr ? otherwise : number_at(record.data(), *at[k]);
    };
    CloudPoint point;
    point.position = {number(0, 0), number(1, 0), number(2, 0)};
    point.normal = {number(3, 0), number(4, 0), number(5, 0)};
    for (int k = 0; k < 3; ++k)
      point.color[k] =
          cv::saturate_cast<std::uint8_t>(number(6 + static_cast<std::size_t>(k), 128));
    point.confidence = number(9, 1);
    if (!is_finite(point.position) || !is_finite(point.normal) || !std::isfinite(point.confidence))
      throw InputError(path, fmt::format("point {} has numbers that are not finite", i));
    points.push_back(point);
  }
  return points;
}

}  // namespace tarsier::sfm
