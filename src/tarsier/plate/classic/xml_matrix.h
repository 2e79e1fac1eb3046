// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

namespace tarsier::plate {

struct XmlLimits {
  std::int64_t max_bytes = 64'000'000;
  int max_rows = 200'000;
  int max_cols = 100'000;
  std::int64_t max_values = 20'000'000;  // of all matrices together
  int max_matrices = 64;
};

// The matrices of an XML file that OpenCV's FileStorage wrote: elements of type "opencv-matrix"
// right below <opencv_storage>. Only this form is read, by a reader of its own without recursion:
// cv::FileStorage overflows its stack on nested elements. Each matrix is CV_32F whatever its <dt>
// (u, c, w, s, i, f, d; one channel). Throws InputError naming `name` and the line.
[[nodiscard]] std::map<std::string, cv::Mat> parse_xml_matrices(std::string_view text,
                                                                const std::string& name,
                                                                const XmlLimits& limits = {});
[[nodiscard]] std::map<std::string, cv::Mat> read_xml_matrices(const std::string& path,
                                                               const XmlLimits& limits = {});

// A matrix that must be there. Throws InputError naming what there is.
[[nodiscard]] const cv::Mat& matrix_named(const std::map<std::string, cv::Mat>& matrices,
                                          const std::string& matrix, const std::string& path);

}  // namespace tarsier::plate
