// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::geometry {

constexpr int kMaxCameraSide = 1'000'000;  // px, limit of the readers

// COLMAP's pixel centres are at 0.5, Tarsier's at 0.
constexpr double kColmapOffset = 0.5;  // px, colmap minus ours

struct ColmapCamera {
  std::int64_t id = 0;  // 0 .. 2^32 - 1
  Camera camera;
};

// Parses "id MODEL width height parameters...", a line of COLMAP's cameras.txt. Models:
// SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV (a rational lens, or a
// pinhole if k4 k5 k6 are 0) and the fisheyes SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and
// OPENCV_FISHEYE. Throws InputError(path), which names the line and the fault.
[[nodiscard]] ColmapCamera parse_colmap_camera(std::string_view text, const std::string& path,
                                               std::int64_t line);

// Writes such a line, without newline, with 17 digits. Models: PINHOLE without distortion, OPENCV
// without k3, otherwise FULL_OPENCV; OPENCV_FISHEYE.
[[nodiscard]] std::string colmap_camera_line(const ColmapCamera& camera);

// The same as in COLMAP's binary files and databases: model number and parameters.
struct ColmapCameraNumbers {
  int model = 0;
  std::int64_t width = 0;  // px
  std::int64_t height = 0;
  std::vector<double> parameters;
};
// Number of parameters of a model; 0 for models that parse_colmap_camera() does not know.
[[nodiscard]] int colmap_parameter_count(int model);
// Throws InputError(path), which states the fault of camera `id`.
[[nodiscard]] Camera camera_of(const ColmapCameraNumbers& numbers, const std::string& path,
                               std::int64_t id);
[[nodiscard]] ColmapCameraNumbers numbers_of(const Camera& camera);

}  // namespace tarsier::geometry
