// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/image_file.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <span>
#include <string>

namespace tarsier {

// As decode_image(), read_image() and read_gray_image(), but the pixels are as stored in the file:
// the EXIF rotation is not applied.
[[nodiscard]] cv::Mat decode_stored_image(std::span<const std::uint8_t> bytes,
                                          const std::string& name, const ImageLimits& limits = {});
[[nodiscard]] cv::Mat read_stored_image(const std::string& path, const ImageLimits& limits = {});
[[nodiscard]] cv::Mat read_stored_gray_image(const std::string& path,
                                             const ImageLimits& limits = {});  // CV_8UC1

}  // namespace tarsier
