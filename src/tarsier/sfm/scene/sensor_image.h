// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/exif.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <string>

// Images with the pixels as the camera's sensor gave them, for all computations with a lens. A
// camera in portrait position stores the same pixels as in landscape position, and EXIF asks
// viewers to turn them by a quarter turn. Without that turn, all images of a device have one size
// and one lens, as in COLMAP.
namespace tarsier::sfm {

// Clockwise quarter turns, 0..3, that bring an image of this orientation (1..8, else 0 turns)
// upright.
[[nodiscard]] int quarter_turns_of(int orientation);

// Direction in which the upright image's lower edge lies: a unit vector of the camera frame (x
// right, y down in the pixels of the sensor).
[[nodiscard]] Eigen::Vector3d down_direction(int quarter_turns);

// Converts stored pixels to those of the sensor. Mirrored images (orientation 2, 4, 5, 7) are
// mirrored back, left to right, as a mirrored image is geometrically inconsistent with all others.
[[nodiscard]] cv::Mat sensor_pixels(const cv::Mat& stored, int orientation);

// As decode_image(), read_image() and read_gray_image() (media/image_file.h).
[[nodiscard]] cv::Mat decode_sensor_image(std::span<const std::uint8_t> bytes,
                                          const std::string& name, const Exif& exif);
[[nodiscard]] cv::Mat read_sensor_image(const std::string& path);
[[nodiscard]] cv::Mat read_sensor_gray_image(const std::string& path);  // CV_8UC1

// The EXIF orientation, 1..8; 1 where it is missing. Throws InputError where the file cannot be
// read.
[[nodiscard]] int orientation_of_file(const std::string& path);

}  // namespace tarsier::sfm
