// SPDX-License-Identifier: MIT
#include "tarsier/face/people/classical.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::face::people {

cv::Mat equalize_halves(const cv::Mat& gray) {
  require_gray(gray);
  TARSIER_REQUIRE(gray.cols >= 8, "{} px wide", gray.cols);
  const int middle = gray.cols / 2;
  cv::Mat whole;
  cv::Mat left;
  cv::Mat right;
  cv::equalizeHist(gray, whole);
  cv::equalizeHist(gray(cv::Rect(0, 0, middle, gray.rows)), left);
  cv::equalizeHist(gray(cv::Rect(middle, 0, gray.cols - middle, gray.rows)), right);
  cv::Mat out(gray.size(), CV_8UC1);
  const double quarter = gray.cols / 4.0;
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) {
      // Weight of the whole: 0 in the outer quarters, 1 in the middle.
      const double from_edge = std::min(x, gray.cols - 1 - x);
      const double share = std::clamp((from_edge - quarter) / quarter, 0.0, 1.0);
      const int half =
          x < middle ? left.at<unsigned char>(y, x) : right.at<unsigned char>(y, x - middle);
      out.at<unsigned char>(y, x) = cv::saturate_cast<unsigned char>(
          share * whole.at<unsigned char>(y, x) + (1 - share) * half);
    }
  }
  return out;
}

cv::Mat classical_face(const cv::Mat& gray, const Eyes& eyes, const ClassicalOptions& options,
                       DebugSink* debug) {
  options.check();
  const cv::Mat crop =
      crop_face(gray, eyes, {{options.size, options.size}, options.eye_x, options.eye_y});
  if (debug != nullptr) debug->image("cut", crop);
  cv::Mat face;
  if (options.halves) {
    face = equalize_halves(crop);
  } else {
    cv::equalizeHist(crop, face);
  }
  if (debug != nullptr) debug->image("equalised", face);
  if (options.smooth_color > 0) {
    cv::Mat smooth;
    cv::bilateralFilter(face, smooth, 0, options.smooth_color, options.smooth_space);
    face = smooth;
    if (debug != nullptr) debug->image("smoothed", face);
  }
  if (options.mask) {
    cv::Mat inside = cv::Mat::zeros(face.size(), CV_8UC1);
    cv::ellipse(inside, {cvRound(0.5 * options.size), cvRound(0.4 * options.size)},
                {cvRound(0.5 * options.size), cvRound(0.8 * options.size)}, 0, 0, 360,
                cv::Scalar(255), cv::FILLED);
    face.setTo(cv::Scalar(128), inside == 0);
    if (debug != nullptr) debug->image("masked", face);
  }
  return face;
}

cv::Mat classical_face(const cv::Mat& crop, const CropOptions& crop_options,
                       const ClassicalOptions& options, DebugSink* debug) {
  crop_options.check();
  const double y = crop_options.eye_y * crop.rows - 0.5;
  return classical_face(
      crop,
      {{crop_options.eye_x * crop.cols - 0.5, y}, {(1 - crop_options.eye_x) * crop.cols - 0.5, y}},
      options, debug);
}

double face_difference(const cv::Mat& a, const cv::Mat& b) {
  require_gray(a);
  TARSIER_REQUIRE(a.size() == b.size() && b.type() == CV_8UC1, "{}x{} and {}x{}", a.cols, a.rows,
                  b.cols, b.rows);
  return cv::norm(a, b, cv::NORM_L2) / static_cast<double>(a.total());
}

}  // namespace tarsier::face::people
