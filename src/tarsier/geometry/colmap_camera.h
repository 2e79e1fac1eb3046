// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::geometry {

constexpr int kMaxCameraSide = 1'000'000;  // px, that the readers take

// COLMAP's pixels have their middles at 0.5, ours at 0.
constexpr double kColmapOffset = 0.5;  // px, colmap minus ours

struct ColmapCamera {
  std::int64_t id = 0;  // 0 .. 2^32 - 1
  Camera camera;
};

// "id MODEL width height parameters...", a line of COLMAP's cameras.txt, models SIMPLE_PINHOLE,
// PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV (a rational lens, or a pinhole where k4 k5 k6
// are 0) and the fisheyes SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and OPENCV_FISHEYE. Throws
// InputError(path) that names the line and what is wrong in it.
[[nodiscard]] ColmapCamera parse_colmap_camera(std::string_view text, const std::string& path,
                                               std::int64_t line);

// The same line, without its end, with 17 digits: PINHOLE without distortion, OPENCV without k3,
// else FULL_OPENCV; OPENCV_FISHEYE.
[[nodiscard]] std::string colmap_camera_line(const ColmapCamera& camera);

// The same as COLMAP's binary files and databases have it: the model's number and its parameters.
struct ColmapCameraNumbers {
  int model = 0;
  std::int64_t width = 0;  // px
  std::int64_t height = 0;
  std::vector<double> parameters;
};
// How many parameters a model has; 0 for those that parse_colmap_camera() does not know.
[[nodiscard]] int colmap_parameter_count(int model);
// Throws InputError(path) that says what is wrong with camera `id`.
[[nodiscard]] Camera camera_of(const ColmapCameraNumbers& numbers, const std::string& path,
                               std::int64_t id);
[[nodiscard]] ColmapCameraNumbers numbers_of(const Camera& camera);

}  // namespace tarsier::geometry
