// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Images are read only through this header. Before a decoder sees the data, the first bytes must be
// those of an allowed format and the size in the header must be within the limit.

enum class ImageFormat { kJpeg, kPng, kWebp, kBmp, kPnm, kTiff };
[[nodiscard]] std::string_view name_of(ImageFormat format);

struct ImageLimits {
  std::int64_t max_pixels = 100'000'000;  // width x height, >= 1
  std::int64_t max_bytes = 512'000'000;   // of the file, >= 1
  bool allow_tiff = false;
};

struct ImageHeader {
  ImageFormat format{};
  int width = 0;   // px, as stored (before EXIF rotation)
  int height = 0;  // px
};

// Reads format and size from the first bytes of a file; nullopt if the format is unknown or the
// header is truncated. Never reads outside `bytes`.
[[nodiscard]] std::optional<ImageHeader> probe_image(std::span<const std::uint8_t> bytes);

// Decodes to 8-bit BGR (CV_8UC3; EXIF rotation applied). Throws InputError that names `name` and
// the reason: not an image, too large, truncated or corrupt data.
[[nodiscard]] cv::Mat decode_image(std::span<const std::uint8_t> bytes, const std::string& name,
                                   const ImageLimits& limits = {});
[[nodiscard]] cv::Mat read_image(const std::string& path, const ImageLimits& limits = {});
[[nodiscard]] cv::Mat read_gray_image(const std::string& path,
                                      const ImageLimits& limits = {});  // CV_8UC1

// Encodes by the extension of `path` (.png, .jpg, .jpeg, .webp, .bmp, .ppm, .pgm) and writes
// atomically. Throws OutputError; UsageError for another extension.
void write_image(const std::string& path, const cv::Mat& image, int jpeg_quality = 90);

// Returns the encoded bytes of an image; `extension` includes the dot. Throws UsageError for an
// unknown extension and OutputError(name) if the format cannot hold the image (size).
[[nodiscard]] std::vector<std::uint8_t> encode_image(std::string_view extension,
                                                     const cv::Mat& image, const std::string& name,
                                                     int jpeg_quality = 90);

// True for the extensions that write_image() supports.
[[nodiscard]] bool is_image_path(std::string_view path);

// Reads the first bytes of a file, at most `max_bytes`. Throws InputError as read_file() does.
[[nodiscard]] std::string read_start(const std::string& path, std::int64_t max_bytes);

// Reads a whole file. Throws InputError (missing, a folder, larger than `max_bytes`).
[[nodiscard]] std::string read_file(const std::string& path, std::int64_t max_bytes);

}  // namespace tarsier
