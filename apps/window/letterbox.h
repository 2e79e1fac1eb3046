// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

namespace tarsier::window {

// The position of an image in a window of another aspect ratio: centred, as large as possible, with
// its aspect ratio kept.
struct Letterbox {
  double scale = 1;  // window pixels per image pixel
  cv::Rect inside;   // the image in the window, px

  // Converts a window pixel to an image pixel (centres at integers).
  [[nodiscard]] cv::Point2d to_image(cv::Point2d window_px) const;
};

// Requires positive sizes.
[[nodiscard]] Letterbox fit(cv::Size image, cv::Size window);

// The size of a new window that shows `image` on a screen: the image's own size if it fits.
[[nodiscard]] cv::Size initial_size(cv::Size image, cv::Size screen);

// Draws `image` (CV_8UC3) into `canvas` of size `window` as fit() computes, with black borders.
// Reuses the buffer.
void compose(const cv::Mat& image, cv::Size window, cv::Mat& canvas);

}  // namespace tarsier::window
