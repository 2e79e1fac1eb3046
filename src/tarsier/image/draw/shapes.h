// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <string_view>

namespace tarsier::image::draw {

// Draws shapes on images: CV_8UC3 (BGR) or CV_8UC1, not empty; otherwise std::invalid_argument is
// thrown. Points are in px, pixel centres at integers. Shapes are clipped to the image.

// Throws std::invalid_argument unless `image` can be drawn on.
void require_canvas(const cv::Mat& image);

// A filled disk with a dark rim, visible on any background. `radius` in px, > 0; drawn with a
// precision of 1/16 px.
void point(cv::Mat& image, cv::Point2d at, const cv::Scalar& color, double radius = 3);

// A cross of four arms with a dark rim. `arm` is the length of an arm in px, > 0.
void cross(cv::Mat& image, cv::Point2d at, const cv::Scalar& color, double arm = 6);

// A filled rectangle with rounded corners, blended with `opacity` 0..1. `radius` in px, >= 0,
// limited by the rectangle.
void fill_rounded(cv::Mat& image, const cv::Rect& box, int radius, const cv::Scalar& color,
                  double opacity = 1);

// A button with a centred label, whose letters are scaled to fit; `pressed` highlights it.
void button(cv::Mat& image, const cv::Rect& box, std::string_view label, bool pressed = false);

// A horizontal bar: `fraction` 0..1 of `box` is filled from the left. The label, if any, is on the
// right.
void bar(cv::Mat& image, const cv::Rect& box, double fraction, const cv::Scalar& color,
         std::string_view label = "");

}  // namespace tarsier::image::draw
