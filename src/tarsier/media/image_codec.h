// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/image_file.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

// JPEG and PNG by libjpeg-turbo and libpng directly, for image_file.cpp. The results are those of
// OpenCV with the same two libraries (4.6: identical to the byte), without loading OpenCV's other
// codecs (lazy_opencv.h).
namespace tarsier {

// Decodes to an 8-bit image, BGR or (`gray`) one channel. Returns an empty image where OpenCV must
// decode: any other format, EXIF (it may rotate the image), CMYK, palettes, transparency, 16 bits,
// interlaced PNG, and files that libjpeg or libpng warn of, except for spare bytes before a JPEG's
// marker. `bytes` must have been checked (image_probe.h).
[[nodiscard]] cv::Mat decode_plain(std::span<const std::uint8_t> bytes, const ImageHeader& header,
                                   bool gray);

// `extension` is ".jpg", ".jpeg" or ".png"; the image has 8 bits and 1 or 3 channels (BGR). Returns
// an empty vector where OpenCV must encode. JPEG: baseline, 4:2:0, jpeg_quality in 1..100.
[[nodiscard]] std::vector<std::uint8_t> encode_plain(std::string_view extension,
                                                     const cv::Mat& image, int jpeg_quality);

}  // namespace tarsier
