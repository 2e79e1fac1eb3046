// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/options.h"

#include <opencv2/core/mat.hpp>

// The definition of the filters in plain OpenCV calls. The fast kernels are compared with it, and
// `--quality reference` runs it. Frames are CV_8UC3 BGR; masks are CV_8UC1, 0 on lines and 255
// elsewhere.
namespace tarsier::cartoon::reference {

// Grey and median filtered: the input of the line detection.
[[nodiscard]] cv::Mat smooth_gray(const cv::Mat& frame, const SketchOptions& options);

// The 8-bit Laplacian response of smooth_gray.
[[nodiscard]] cv::Mat line_response(const cv::Mat& gray, const SketchOptions& options);

// The Scharr response of smooth_gray: sum of +x and -x (and +-y).
[[nodiscard]] cv::Mat evil_response(const cv::Mat& gray, const EvilOptions& options);

// Whitens the 3x3 pixels around each black pixel whose 5x5 border is all white. All pixels are
// tested on the input mask, so the result does not depend on an order. Pixels closer than 2 to the
// border do not change.
void remove_pepper(cv::Mat& mask);

[[nodiscard]] cv::Mat sketch_mask(const cv::Mat& frame, const SketchOptions& options);
[[nodiscard]] cv::Mat evil_mask(const cv::Mat& frame, const SketchOptions& sketch,
                                const EvilOptions& options);

// The painting at half size (w/2 x h/2, rounded down).
[[nodiscard]] cv::Mat paint_small(const cv::Mat& frame, const PaintOptions& options);

// The image of options.mode. Ignores quality, steady and the automatic face detection.
[[nodiscard]] cv::Mat cartoonize(const cv::Mat& frame, const CartoonOptions& options);

}  // namespace tarsier::cartoon::reference
