// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>

// What the files of fuzz_seeds share.
namespace tarsier {

// The path of FOLDER/TARGET/good-NAME, whose folder is there.
[[nodiscard]] std::string seed(const std::string& target, const std::string& name);

// CV_8UC1, the same each time.
[[nodiscard]] cv::Mat texture(cv::Size size);

// Of the targets in sfm.cpp.
void reconstruction_seeds();

}  // namespace tarsier
