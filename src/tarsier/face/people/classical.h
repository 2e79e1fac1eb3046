// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/face/people/eyes.h"

#include <opencv2/core/mat.hpp>

// Preprocessing of faces for Eigenfaces and Fisherfaces (as in Baggio et al., "Mastering OpenCV
// with Practical Computer Vision Projects", 2012, chapter 8).
namespace tarsier::face::people {

struct ClassicalOptions {
  int size = 70;        // px, square
  double eye_x = 0.16;  // of the left eye, share of the size
  double eye_y = 0.14;
  // Equalise the left half, the right half and the whole separately, and blend them.
  bool halves = true;
  double smooth_color = 20;  // of the bilateral filter, grey levels; 0 disables it
  double smooth_space = 2;   // px
  bool mask = true;  // fill with grey outside an ellipse at (0.5, 0.4) with half axes (0.5, 0.8)

  [[nodiscard]] OptionFields fields() {
    return {{"size", size, range(32, 256)},
            {"eye_x", eye_x, inside(0, 0.5)},
            {"eye_y", eye_y, inside(0, 1)},
            {"smooth_color", smooth_color, range(0, 255)},
            {"smooth_space", smooth_space, above(0, 20)}};
  }
  void check() const { check_fields(*this); }
};

// From an image (CV_8UC1) and the eyes in it. `debug` receives "cut", "equalised", "smoothed",
// "masked".
[[nodiscard]] cv::Mat classical_face(const cv::Mat& gray, const Eyes& eyes,
                                     const ClassicalOptions& options = {},
                                     DebugSink* debug = nullptr);
// From a face that crop_face() cropped with `crop_options`.
[[nodiscard]] cv::Mat classical_face(const cv::Mat& crop, const CropOptions& crop_options = {},
                                     const ClassicalOptions& options = {},
                                     DebugSink* debug = nullptr);

// Reduces light from one side. Left of a quarter of the width, the result is the equalised left
// half; right of three quarters, the equalised right half; in the middle, the equalised whole. In
// between they are blended linearly.
[[nodiscard]] cv::Mat equalize_halves(const cv::Mat& gray);

// sqrt(sum of squared grey differences) / pixels. For the usual 70 x 70 faces, 0.3 is clearly
// another image. Equal sizes, CV_8UC1.
[[nodiscard]] double face_difference(const cv::Mat& a, const cv::Mat& b);

}  // namespace tarsier::face::people
