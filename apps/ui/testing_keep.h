// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/imgcodecs.hpp>

#include <cstdlib>
#include <string>

namespace tarsier::test_support {

// Writes <name>.png into the folder TARSIER_KEEP, if that is set.
inline void keep_image(const cv::Mat& image, const std::string& name) {
  if (const char* folder = std::getenv("TARSIER_KEEP"))
    cv::imwrite(std::string(folder) + "/" + name + ".png", image);
}

}  // namespace tarsier::test_support
