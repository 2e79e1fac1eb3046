// SPDX-License-Identifier: MIT
#include "letterbox.h"

#include "tarsier/core/image.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::window {

Letterbox fit(cv::Size picture, cv::Size window) {
  TARSIER_REQUIRE(picture.width > 0 && picture.height > 0 && window.width > 0 && window.height > 0,
                  "picture {}x{}, window {}x{}", picture.width, picture.height, window.width,
                  window.height);
  Letterbox box;
  box.scale = std::min(static_cast<double>(window.width) / picture.width,
                       static_cast<double>(window.height) / picture.height);
  const int width = std::clamp(cvRound(picture.width * box.scale), 1, window.width);
  const int height = std::clamp(cvRound(picture.height * box.scale), 1, window.height);
  box.inside = {(window.width - width) / 2, (window.height - height) / 2, width, height};
  return box;
}

cv::Point2d Letterbox::to_picture(cv::Point2d window_px) const {
  return {(window_px.x - inside.x + 0.5) / scale - 0.5,
          (window_px.y - inside.y + 0.5) / scale - 0.5};
}

cv::Size initial_size(cv::Size picture, cv::Size screen) {
  // Several monitors side by side are one wide screen to X: a window should not spread over them.
  // Some of the height goes to the title bar, the sliders and the desktop's panel.
  const double width = std::min(screen.width * 0.95, screen.height * 1.9);
  const double height = screen.height * 0.85;
  const double scale = std::min({1.0, width / picture.width, height / picture.height});
  return {std::max(1, cvRound(picture.width * scale)),
          std::max(1, cvRound(picture.height * scale))};
}

void compose(const cv::Mat& picture, cv::Size window, cv::Mat& canvas) {
  require_bgr(picture);
  const Letterbox box = fit(picture.size(), window);
  canvas.create(window, CV_8UC3);
  if (box.inside.size() != window) canvas.setTo(cv::Scalar::all(0));
  cv::Mat inside = canvas(box.inside);
  if (box.inside.size() == picture.size()) {
    picture.copyTo(inside);
  } else {
    cv::resize(picture, inside, inside.size(), 0, 0,
               box.scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  }
}

}  // namespace tarsier::window
