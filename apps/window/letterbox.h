// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

namespace tarsier::window {

// Where a picture lies in a window of another shape: as large as it fits, in the middle, aspect
// kept.
struct Letterbox {
  double scale = 1;  // window pixels per picture pixel
  cv::Rect inside;   // the picture in the window, px

  // From a window pixel to a picture pixel (centres at integers).
  [[nodiscard]] cv::Point2d to_picture(cv::Point2d window_px) const;
};

// Requires positive sizes.
[[nodiscard]] Letterbox fit(cv::Size picture, cv::Size window);

// The largest size for a new window that shows `picture` on a screen: the picture's own if it fits.
[[nodiscard]] cv::Size initial_size(cv::Size picture, cv::Size screen);

// Draws `picture` (CV_8UC3) into `canvas` of size `window` as fit() says, black around it. Reuses
// the buffer.
void compose(const cv::Mat& picture, cv::Size window, cv::Mat& canvas);

}  // namespace tarsier::window
