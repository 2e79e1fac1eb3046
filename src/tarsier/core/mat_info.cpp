// SPDX-License-Identifier: MIT
#include "tarsier/core/mat_info.h"

#include "tarsier/core/require.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier {
namespace {

std::string type_name(const cv::Mat& mat) { return cv::typeToString(mat.type()); }

std::string labelled(std::string_view name, const std::string& text) {
  return name.empty() ? text : fmt::format("{}: {}", name, text);
}

}  // namespace

std::string mat_info(const cv::Mat& mat, std::string_view name) {
  if (mat.empty()) return labelled(name, "empty");
  TARSIER_REQUIRE(mat.dims == 2, "got {} dimensions", mat.dims);
  cv::Mat values;
  mat.reshape(1).convertTo(values, CV_64F);
  const int channels = mat.channels();
  std::string low;
  std::string high;
  int nans = 0;
  for (int c = 0; c < channels; ++c) {
    double min_value = std::numeric_limits<double>::infinity();
    double max_value = -min_value;
    for (int y = 0; y < values.rows; ++y) {
      const auto* row = values.ptr<double>(y);
      for (int x = c; x < values.cols; x += channels) {
        if (std::isnan(row[x])) {
          ++nans;
          continue;
        }
        min_value = std::min(min_value, row[x]);
        max_value = std::max(max_value, row[x]);
      }
    }
    low += fmt::format("{}{:g}", c > 0 ? " " : "", min_value);
    high += fmt::format("{}{:g}", c > 0 ? " " : "", max_value);
  }
  std::string text =
      fmt::format("{}x{} {}, min ({}), max ({})", mat.cols, mat.rows, type_name(mat), low, high);
  if (nans > 0) text += fmt::format(", {} NaN", nans);
  return labelled(name, text);
}

std::string mat_print(const cv::Mat& mat, std::string_view name, int limit) {
  TARSIER_REQUIRE(limit >= 1, "got {}", limit);
  if (mat.empty()) return labelled(name, "empty") + "\n";
  TARSIER_REQUIRE(mat.dims == 2, "got {} dimensions", mat.dims);
  cv::Mat values;
  mat.reshape(1).convertTo(values, CV_64F);
  const int channels = mat.channels();
  std::string text = labelled(name, fmt::format("{}x{} {}\n", mat.cols, mat.rows, type_name(mat)));
  for (int y = 0; y < std::min(mat.rows, limit); ++y) {
    const auto* row = values.ptr<double>(y);
    for (int x = 0; x < std::min(mat.cols, limit); ++x) {
      text += channels > 1 ? " [" : " ";
      for (int c = 0; c < channels; ++c) {
        text += fmt::format("{}{:g}", c > 0 ? " " : "", row[x * channels + c]);
      }
      if (channels > 1) text += "]";
    }
    text += mat.cols > limit ? " ...\n" : "\n";
  }
  if (mat.rows > limit) text += " ...\n";
  return text;
}

}  // namespace tarsier
