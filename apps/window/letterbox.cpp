// SPDX-License-Identifier: MIT
#include "letterbox.h"

#include "tarsier/core/image.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::window {

Letterbox fit(cv::Size image, cv::Size window) {
  TARSIER_REQUIRE(image.width > 0 && image.height > 0 && window.width > 0 && window.height > 0,
                  "image {}x{}, window {}x{}", image.width, image.height, window.width,
                  window.height);
  Letterbox box;
  box.scale = std::min(static_cast<double>(window.width) / image.width,
                       static_cast<double>(window.height) / image.height);
  const int width = std::clamp(cvRound(image.width * box.scale), 1, window.width);
  const int height = std::clamp(cvRound(image.height * box.scale), 1, window.height);
  box.inside = {(window.width - width) / 2, (window.height - height) / 2, width, height};
  return box;
}

cv::Point2d Letterbox::to_image(cv::Point2d window_px) const {
  return {(window_px.x - inside.x + 0.5) / scale - 0.5,
          (window_px.y - inside.y + 0.5) / scale - 0.5};
}

cv::Size initial_size(cv::Size image, cv::Size screen) {
  // X reports several monitors side by side as one wide screen, and a window should not span them.
  // Some of the height is left for the title bar, the sliders and the desktop's panel.
  const double width = std::min(screen.width * 0.95, screen.height * 1.9);
  const double height = screen.height * 0.85;
  const double scale = std::min({1.0, width / image.width, height / image.height});
  return {std::max(1, cvRound(image.width * scale)), std::max(1, cvRound(image.height * scale))};
}

void compose(const cv::Mat& image, cv::Size window, cv::Mat& canvas) {
  require_bgr(image);
  const Letterbox box = fit(image.size(), window);
  canvas.create(window, CV_8UC3);
  if (box.inside.size() != window) canvas.setTo(cv::Scalar::all(0));
  cv::Mat inside = canvas(box.inside);
  if (box.inside.size() == image.size()) {
    image.copyTo(inside);
  } else {
    cv::resize(image, inside, inside.size(), 0, 0,
               box.scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  }
}

}  // namespace tarsier::window
