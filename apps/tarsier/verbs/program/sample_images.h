// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace tarsier::cli {

// The folder of OpenCV's sample images and videos if Debian's package opencv-doc is installed.
inline constexpr std::string_view kSampleImages = "/usr/share/doc/opencv-doc/examples/data";

// Path of the sample `name`, e.g. "messi5.jpg"; the file need not exist.
[[nodiscard]] inline std::string sample_image(std::string_view name) {
  return (std::filesystem::path(kSampleImages) / name).string();
}

}  // namespace tarsier::cli
