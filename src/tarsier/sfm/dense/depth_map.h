// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core.hpp>

#include <string>

namespace tarsier::sfm {

// What is known of the surface that each pixel of an undistorted image sees. All three have one
// size, that of the image or a smaller one of the same proportion.
struct DepthMap {
  cv::Mat depth;  // CV_32FC1, z in the camera (world units), > 0; 0: unknown
  cv::Mat
      normal;  // CV_32FC3, unit, in the camera's frame (x right, y down, z forward), towards the
               // camera; 0 where the depth is 0
  cv::Mat confidence;  // CV_32FC1, 0..1

  // Throws std::invalid_argument unless there is a depth, and the others are empty or have its size.
  void check() const;
};

// The camera of a map of this size of an image of `camera`: all lengths in proportion. Throws
// std::invalid_argument where the proportions of the sides differ by more than 1 %.
[[nodiscard]] geometry::Camera camera_of_map(const geometry::Camera& camera, cv::Size map);

// Maps of numbers as COLMAP has them: the text "width&height&channels&", then float32 (little
// endian), row by row, one channel after the other. https://colmap.github.io/format.html

// `map`: CV_32FC1 or CV_32FC3. Written whole or not at all. Throws OutputError.
void write_colmap_map(const std::string& path, const cv::Mat& map);

// CV_32FC1 or CV_32FC3, numbers as they are in the file. Throws InputError: missing, another number
// of channels, a size that the file does not have or beyond 32766 px.
[[nodiscard]] cv::Mat read_colmap_map(const std::string& path, int channels);

}  // namespace tarsier::sfm
