// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/depth_map.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <bit>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>

namespace tarsier::sfm {
namespace {

constexpr int kMaxSide = 32'766;
constexpr std::int64_t kMaxBytes = 4'000'000'000;

static_assert(std::endian::native == std::endian::little, "maps are written as they lie in memory");

// The number before the next '&'.
std::optional<int> next_number(std::string_view& rest) {
  const std::size_t end = rest.substr(0, 12).find('&');
  if (end == std::string_view::npos) return std::nullopt;
  const auto number = to_integer(rest.substr(0, end), 1, kMaxSide);
  rest.remove_prefix(end + 1);
  if (!number) return std::nullopt;
  return static_cast<int>(*number);
}

}  // namespace

void DepthMap::check() const {
  TARSIER_REQUIRE(!depth.empty() && depth.type() == CV_32FC1, "a depth of {}x{}, type {}",
                  depth.cols, depth.rows, depth.type());
  TARSIER_REQUIRE(normal.empty() || (normal.size() == depth.size() && normal.type() == CV_32FC3),
                  "normals of {}x{}, type {}", normal.cols, normal.rows, normal.type());
  TARSIER_REQUIRE(
      confidence.empty() || (confidence.size() == depth.size() && confidence.type() == CV_32FC1),
      "a confidence of {}x{}, type {}", confidence.cols, confidence.rows, confidence.type());
}

geometry::Camera camera_of_map(const geometry::Camera& camera, cv::Size map) {
  const auto scaled = geometry::scaled_camera(camera, map);
  TARSIER_REQUIRE(scaled.has_value(), "a map of {}x{} for images of {}x{}", map.width, map.height,
                  camera.width, camera.height);
  return *scaled;
}

void write_colmap_map(const std::string& path, const cv::Mat& map) {
  TARSIER_REQUIRE(!map.empty() && (map.type() == CV_32FC1 || map.type() == CV_32FC3),
                  "a map of {}x{}, type {}", map.cols, map.rows, map.type());
  std::string bytes = fmt::format("{}&{}&{}&", map.cols, map.rows, map.channels());
  const std::size_t row_bytes = static_cast<std::size_t>(map.cols) * sizeof(float);
  bytes.reserve(bytes.size() + row_bytes * static_cast<std::size_t>(map.rows) *
                                   static_cast<std::size_t>(map.channels()));
  cv::Mat plane = map;
  for (int c = 0; c < map.channels(); ++c) {
    if (map.channels() > 1) cv::extractChannel(map, plane, c);
    for (int y = 0; y < map.rows; ++y)
      bytes.append(reinterpret_cast<const char*>(plane.ptr<float>(y)), row_bytes);
  }
  write_file_atomically(path, bytes);
}

cv::Mat read_colmap_map(const std::string& path, int channels) {
  TARSIER_REQUIRE(channels == 1 || channels == 3, "{} channels", channels);
  const std::string bytes = read_file(path, kMaxBytes);
  std::string_view rest = bytes;
  const auto width = next_number(rest);
  const auto height = next_number(rest);
  const auto count = next_number(rest);
  if (!width || !height || !count)
    throw InputError(path,
                     "is not a map of COLMAP: expected 'width&height&channels&' at its start");
  if (*count != channels) {
    throw InputError(path,
                     fmt::format("has {} numbers for each pixel, expected {}", *count, channels));
  }
  const std::size_t row_bytes = static_cast<std::size_t>(*width) * sizeof(float);
  const std::size_t plane_bytes = row_bytes * static_cast<std::size_t>(*height);
  if (rest.size() != plane_bytes * static_cast<std::size_t>(channels)) {
    throw InputError(
        path, fmt::format("is of {}x{} px and has {} bytes of them, expected {}", *width, *height,
                          rest.size(), plane_bytes * static_cast<std::size_t>(channels)));
  }
  cv::Mat map(*height, *width, CV_MAKETYPE(CV_32F, channels));
  for (int c = 0; c < channels; ++c) {
    cv::Mat plane = channels == 1 ? map : cv::Mat(*height, *width, CV_32FC1);
    for (int y = 0; y < *height; ++y) {
      std::memcpy(plane.ptr<float>(y), rest.data(), row_bytes);
      rest.remove_prefix(row_bytes);
    }
    if (channels > 1) cv::insertChannel(plane, map, c);
  }
  return map;
}

}  // namespace tarsier::sfm
