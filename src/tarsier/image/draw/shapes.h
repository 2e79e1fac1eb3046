// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <string_view>

namespace tarsier::image::draw {

// Shapes on images: CV_8UC3 (BGR) or CV_8UC1, not empty; others throw std::invalid_argument.
// Points are in px, centres of pixels at integers; what lies outside the image is cut off.

// Throws std::invalid_argument unless `image` can be drawn on.
void require_canvas(const cv::Mat& image);

// A filled disk with a dark rim, so that it shows on any ground. `radius` in px, > 0; drawn to 1/16
// px.
void point(cv::Mat& image, cv::Point2d at, const cv::Scalar& color, double radius = 3);

// A cross of four arms with a dark rim. `arm` is the length of an arm in px, > 0.
void cross(cv::Mat& image, cv::Point2d at, const cv::Scalar& color, double arm = 6);

// A filled rectangle with rounded corners, blended with `opacity` 0..1. `radius` in px, >= 0 (made
// smaller where the rectangle is).
void fill_rounded(cv::Mat& image, const cv::Rect& box, int radius, const cv::Scalar& color,
                  double opacity = 1);

// A button with a centred label whose letters fit into it; `pressed` lights it up.
void button(cv::Mat& image, const cv::Rect& box, std::string_view label, bool pressed = false);

// A level bar: `fraction` 0..1 of `box` filled from the left, the label beside it on the right if
// there is one.
void bar(cv::Mat& image, const cv::Rect& box, double fraction, const cv::Scalar& color,
         std::string_view label = "");

}  // namespace tarsier::image::draw
