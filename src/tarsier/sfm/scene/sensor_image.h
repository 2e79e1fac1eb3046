// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/exif.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <string>

// Images with the pixels as the sensor of the camera gave them, for all that has to do with a lens. A camera that is held upright
// writes the same pixels as ever, and EXIF says that they are to be shown turned by a quarter. Unturned, all images of a device have one
// size and one lens, as COLMAP takes them too.
namespace tarsier::sfm {

// Quarter turns clockwise, 0..3, that bring the pixels of an image of this orientation (1..8, else 0 turns) upright.
[[nodiscard]] int quarter_turns_of(int orientation);

// Where the lower edge of what it shows lies, a unit vector of its frame (x right, y down in the pixels of the sensor).
[[nodiscard]] Eigen::Vector3d down_of(int quarter_turns);

// Pixels as a file stores them to those of the sensor: mirrored ones (orientation 2, 4, 5, 7) are mirrored back, left to right, as a
// mirrored image agrees with no other about the scene.
[[nodiscard]] cv::Mat sensor_pixels(const cv::Mat& stored, int orientation);

// As decode_image(), read_image() and read_gray_image() (media/image_file.h).
[[nodiscard]] cv::Mat decode_sensor_image(std::span<const std::uint8_t> bytes,
                                          const std::string& name, const Exif& exif);
[[nodiscard]] cv::Mat read_sensor_image(const std::string& path);
[[nodiscard]] cv::Mat read_sensor_gray_image(const std::string& path);  // CV_8UC1

// The orientation of EXIF, 1..8; 1 where it says none. Throws InputError where the file cannot be read.
[[nodiscard]] int orientation_of_file(const std::string& path);

}  // namespace tarsier::sfm
