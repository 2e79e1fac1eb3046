// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <vector>

// Images of 640 x 480 px with two drawn eyes, for tests of blinks.
namespace tarsier::face::head::test_support {

inline constexpr double kFps = 15;  // of the videos
constexpr int kShift = 4;           // fractional bits of pixel coordinates

inline std::vector<cv::Point> pixels_of(const Eigen::Matrix2Xd& points, Eigen::Index first,
                                        Eigen::Index count, cv::Point corner) {
  std::vector<cv::Point> out;
  for (Eigen::Index i = first; i < first + count; ++i)
    out.emplace_back(cvRound((1 << kShift) * (points(0, i) - corner.x)),
                     cvRound((1 << kShift) * (points(1, i) - corner.y)));
  return out;
}

// `points`: iBUG's 68, then the outlines of the two irises (the same number of points each), which
// are visible only between the lids.
inline cv::Mat image_of_eyes(const Eigen::Matrix2Xd& points) {
  cv::Mat image(480, 640, CV_8UC1, cv::Scalar(150));
  const Eigen::Index outline = (points.cols() - 68) / 2;
  for (Eigen::Index eye = 0; eye < 2; ++eye) {
    const auto lids_at = points.middleCols(36 + 6 * eye, 6);
    const cv::Point corner(static_cast<int>(lids_at.row(0).minCoeff()) - 2,
                           static_cast<int>(lids_at.row(1).minCoeff()) - 2);
    const cv::Point end(static_cast<int>(lids_at.row(0).maxCoeff()) + 4,
                        static_cast<int>(lids_at.row(1).maxCoeff()) + 4);
    cv::Mat part = image(cv::Rect(corner, end));
    cv::Mat between(part.size(), CV_8UC1, cv::Scalar(0));
    const auto lids = pixels_of(points, 36 + 6 * eye, 6, corner);
    cv::fillPoly(between, lids, cv::Scalar(255), cv::LINE_AA, kShift);
    cv::Mat eyeball(part.size(), CV_8UC1, cv::Scalar(220));
    cv::fillPoly(eyeball, pixels_of(points, 68 + outline * eye, outline, corner), cv::Scalar(40),
                 cv::LINE_AA, kShift);
    eyeball.copyTo(part, between);
    cv::polylines(part, lids, true, cv::Scalar(70), 1, cv::LINE_AA, kShift);  // lashes
  }
  return image;
}

}  // namespace tarsier::face::head::test_support
