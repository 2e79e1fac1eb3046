// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/image_file.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

// JPEG and PNG by libjpeg-turbo and libpng themselves, for image_file.cpp: what OpenCV makes with
// the same two libraries (4.6: to the byte), without loading its codecs of everything else
// (lazy_opencv.h).
namespace tarsier {

// An 8-bit image, BGR or (`gray`) one channel. Empty for what is left to OpenCV: any other format,
// EXIF (it may turn the image), CMYK, palettes, transparency, 16 bits, interlaced PNG, and what
// libjpeg or libpng warn of, but for bytes to spare before a JPEG's marker. `bytes` have been
// checked (image_probe.h).
[[nodiscard]] cv::Mat decode_plain(std::span<const std::uint8_t> bytes, const ImageHeader& header,
                                   bool gray);

// `ending` (".jpg", ".jpeg", ".png"); an 8-bit image of 1 or 3 channels (BGR). Empty for what is
// left to OpenCV. JPEG: baseline, 4:2:0, jpeg_quality in 1..100.
[[nodiscard]] std::vector<std::uint8_t> encode_plain(std::string_view ending, const cv::Mat& image,
                                                     int jpeg_quality);

}  // namespace tarsier
