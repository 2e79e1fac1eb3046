// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/cloud.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/dense/ply_file.h"

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
              "points are written in their memory layout");

constexpr std::size_t kHeaderBytes = 320;
constexpr std::size_t kPointBytes = 6 * 4 + 3 + 4;

// The header has a fixed length for any count; the comment fills the rest.
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
        "point {} is not finite", count_);
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
  const PlyElement layout = read_ply_header(stream, path).front();
  const std::array<const PlyProperty*, 10> at{
      layout.find("x"),   layout.find("y"),         layout.find("z"),    layout.find("nx"),
      layout.find("ny"),  layout.find("nz"),        layout.find("blue"), layout.find("green"),
      layout.find("red"), layout.find("confidence")};
  if (at[0] == nullptr || at[1] == nullptr || at[2] == nullptr)
    throw InputError(path, "has no points with x, y and z");
  std::vector<CloudPoint> points;
  std::vector<char> record(layout.bytes);
  for (std::int64_t i = 0; i < layout.count; ++i) {
    if (!stream.read(record.data(), static_cast<std::streamsize>(record.size())))
      throw InputError(path, fmt::format("is truncated after {} of {} points", i, layout.count));
    const auto number = [&](std::size_t k, float otherwise) {
      if (at[k] == nullptr) return otherwise;
      return static_cast<float>(at[k]->type.read(record.data() + at[k]->offset));
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
