// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/dark_background.h"

#include <opencv2/imgproc.hpp>

#include <filesystem>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr double kMinShare = 0.05;    // of the image
constexpr double kMinUnknown = 0.70;  // of the part

}  // namespace

cv::Mat1b dark_background(const cv::Mat& bgr, const cv::Mat& depth, int level) {
  cv::Mat gray;
  cv::cvtColor(bgr, gray, cv::COLOR_BGR2GRAY);
  if (gray.size() != depth.size()) cv::resize(gray, gray, depth.size(), 0, 0, cv::INTER_AREA);
  const cv::Mat dark = gray <= level;
  cv::Mat labels;
  cv::Mat stats;
  cv::Mat centers;
  const int count = cv::connectedComponentsWithStats(dark, labels, stats, centers, 4, CV_32S);
  std::vector<int> unknown(static_cast<std::size_t>(count), 0);
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x)
      if (!(depth.at<float>(y, x) > 0)) ++unknown[static_cast<std::size_t>(labels.at<int>(y, x))];
  std::vector<char> is_background(static_cast<std::size_t>(count), 0);
  for (int part = 1; part < count; ++part) {
    const int area = stats.at<int>(part, cv::CC_STAT_AREA);
    const int left = stats.at<int>(part, cv::CC_STAT_LEFT);
    const int top = stats.at<int>(part, cv::CC_STAT_TOP);
    const bool reaches_border = left == 0 || top == 0 ||
                                left + stats.at<int>(part, cv::CC_STAT_WIDTH) == depth.cols ||
                                top + stats.at<int>(part, cv::CC_STAT_HEIGHT) == depth.rows;
    is_background[static_cast<std::size_t>(part)] =
        reaches_border && area >= kMinShare * static_cast<double>(depth.total()) &&
        unknown[static_cast<std::size_t>(part)] >= kMinUnknown * area;
  }
  cv::Mat1b result(depth.size(), static_cast<unsigned char>(0));
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x)
      if (is_background[static_cast<std::size_t>(labels.at<int>(y, x))] != 0) result(y, x) = 255;
  return result;
}

cv::Mat1b dark_background(const Workspace& workspace, int view, int level) {
  std::error_code ignored;
  if (level == 0 || !workspace.has_depth_map(view) ||
      !std::filesystem::is_regular_file(workspace.path_of_image(view), ignored))
    return {};
  return dark_background(workspace.read_image(view), workspace.read_depth_map(view).depth, level);
}

}  // namespace tarsier::sfm
