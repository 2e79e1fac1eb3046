// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonize.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::cartoon {

void draw_face_outline(cv::Mat& image, double opacity) {
  require_bgr(image);
  TARSIER_REQUIRE(opacity >= 0 && opacity <= 1, "got {}", opacity);
  if (opacity == 0) return;
  cv::Mat drawn = image.clone();
  const cv::Scalar yellow(0, 255, 255);
  const int w = image.cols;
  const int h = image.rows;
  const cv::Point center(w / 2, h / 2);
  const int face_height = h * 70 / 100;
  const int face_width = face_height * 72 / 100;
  const int line = std::max(1, h / 160);
  cv::ellipse(drawn, center, {face_width / 2, face_height / 2}, 0, 0, 360, yellow, line,
              cv::LINE_AA);

  // Eyes: upper and lower lid as arcs, and the iris.
  const int eye_width = face_width * 23 / 100;
  const int eye_height = face_width * 11 / 100;
  const int eye_y = center.y - face_height * 8 / 100;
  for (const int side : {-1, 1}) {
    const cv::Point eye(center.x + side * face_width * 21 / 100, eye_y);
    cv::ellipse(drawn, eye, {eye_width / 2, eye_height}, 0, 195, 345, yellow, line, cv::LINE_AA);
    cv::ellipse(drawn, eye, {eye_width / 2, eye_height * 2 / 3}, 0, 15, 165, yellow, line,
                cv::LINE_AA);
    cv::circle(drawn, eye, std::max(1, eye_height / 3), yellow, line, cv::LINE_AA);
  }
  // The lower lip.
  const cv::Point mouth(center.x, center.y + face_height * 22 / 100);
  cv::ellipse(drawn, mouth, {face_width * 18 / 100, face_height * 6 / 100}, 0, 10, 170, yellow,
              line, cv::LINE_AA);

  const std::string text = "Put your face here";
  const double scale = std::max(0.4, h / 600.0);
  int below = 0;
  const cv::Size size = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale, line, &below);
  const cv::Point at(center.x - size.width / 2,
                     std::max(size.height + line, center.y - face_height / 2 - size.height));
  cv::putText(drawn, text, at, cv::FONT_HERSHEY_SIMPLEX, scale, {0, 0, 0}, 3 * line, cv::LINE_AA);
  cv::putText(drawn, text, at, cv::FONT_HERSHEY_SIMPLEX, scale, yellow, line, cv::LINE_AA);
  cv::addWeighted(drawn, opacity, image, 1 - opacity, 0, image);
}

}  // namespace tarsier::cartoon
