// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/sensor_image.h"

#include "tarsier/media/image_file.h"
#include "tarsier/media/stored_image.h"

#include <opencv2/core.hpp>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kExifBytes = 1 << 20;  // EXIF segments come before the image data

}  // namespace

int quarter_turns_of(int orientation) {
  switch (orientation) {
    case 3:
    case 4:
      return 2;
    case 6:
    case 7:
      return 1;
    case 5:
    case 8:
      return 3;
    default:
      return 0;
  }
}

Eigen::Vector3d down_direction(int quarter_turns) {
  const double sign = quarter_turns < 2 ? 1 : -1;
  return quarter_turns % 2 == 0 ? Eigen::Vector3d(0, sign, 0) : Eigen::Vector3d(sign, 0, 0);
}

cv::Mat sensor_pixels(const cv::Mat& stored, int orientation) {
  if (orientation != 2 && orientation != 4 && orientation != 5 && orientation != 7) return stored;
  cv::Mat pixels;
  cv::flip(stored, pixels, 1);
  return pixels;
}

cv::Mat decode_sensor_image(std::span<const std::uint8_t> bytes, const std::string& name,
                            const Exif& exif) {
  return sensor_pixels(decode_stored_image(bytes, name), exif.orientation);
}

cv::Mat read_sensor_image(const std::string& path) {
  return sensor_pixels(read_stored_image(path), orientation_of_file(path));
}

cv::Mat read_sensor_gray_image(const std::string& path) {
  return sensor_pixels(read_stored_gray_image(path), orientation_of_file(path));
}

int orientation_of_file(const std::string& path) {
  return parse_exif(read_start(path, kExifBytes)).orientation;
}

}  // namespace tarsier::sfm
