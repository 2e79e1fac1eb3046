// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core.hpp>

#include <string>

namespace tarsier::sfm {

// The surface seen by each pixel of an undistorted image. All maps have the same size, that of the
// image or a smaller one of the same aspect ratio.
struct DepthMap {
  cv::Mat depth;  // CV_32FC1, z in the camera (world units), > 0; 0: unknown
  // CV_32FC3, unit, in the camera frame (x right, y down, z forward), pointing to the camera; 0
  // where the depth is 0
  cv::Mat normal;
  cv::Mat confidence;  // CV_32FC1, 0..1

  // Throws std::invalid_argument unless there is a depth map and the others are empty or have its
  // size.
  void check() const;
};

// The camera of a map of this size for an image of `camera`; all lengths are scaled. Throws
// std::invalid_argument where the aspect ratios differ (geometry::scaled_camera()).
[[nodiscard]] geometry::Camera camera_of_map(const geometry::Camera& camera, cv::Size map);

// COLMAP's format for maps: the text "width&height&channels&", then float32 (little endian), row by
// row, one channel after the other. https://colmap.github.io/format.html

// `map`: CV_32FC1 or CV_32FC3. Written completely or not at all. Throws OutputError.
void write_colmap_map(const std::string& path, const cv::Mat& map);

// Returns CV_32FC1 or CV_32FC3 with the numbers of the file. Throws InputError: a missing file,
// another number of channels, a size that does not match the file or exceeds 32766 px.
[[nodiscard]] cv::Mat read_colmap_map(const std::string& path, int channels);

}  // namespace tarsier::sfm
