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
  std::int64_t max_values = 20'000'000;  // sum over all matrices
  int max_matrices = 64;
};

// Parses the matrices of an XML file written by OpenCV's FileStorage: elements of type
// "opencv-matrix" directly below <opencv_storage>. Other elements are not supported. The parser
// does not recurse, because cv::FileStorage overflows its stack on nested elements. Each matrix
// becomes CV_32F whatever its <dt> (u, c, w, s, i, f, d; one channel). Throws InputError, which
// names `name` and the line.
[[nodiscard]] std::map<std::string, cv::Mat> parse_xml_matrices(std::string_view text,
                                                                const std::string& name,
                                                                const XmlLimits& limits = {});
[[nodiscard]] std::map<std::string, cv::Mat> read_xml_matrices(const std::string& path,
                                                               const XmlLimits& limits = {});

// Returns a required matrix. Throws InputError, which lists the matrices of the file.
[[nodiscard]] const cv::Mat& matrix_named(const std::map<std::string, cv::Mat>& matrices,
                                          const std::string& matrix, const std::string& path);

}  // namespace tarsier::plate
