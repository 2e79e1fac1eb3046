// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>

// Common parts of the files of fuzz_seeds.
namespace tarsier {

// The path of FOLDER/TARGET/good-NAME, whose folder exists.
[[nodiscard]] std::string seed(const std::string& target, const std::string& name);

// CV_8UC1, the same on every call.
[[nodiscard]] cv::Mat texture(cv::Size size);

// Writes the seeds of the targets in sfm.cpp.
void reconstruction_seeds();

}  // namespace tarsier
