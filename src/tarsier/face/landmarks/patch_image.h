// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/patches.h"
#include "tarsier/face/shape/similarity.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

// What training, fitting and drawing of patches share. Not for other modules.
namespace tarsier::face::landmarks::detail {

// Correlations read this many floats beyond the right edge of what they need.
inline constexpr int kOverread = 8;

// Part of an image, reduced by a whole number (boxes averaged), so that bilinear sampling near
// `scale` image pixels a step does not alias. Pixel (u, v) of `gray` lies at
// origin + step * (u, v) in the image: with boxes the origin carries the (step - 1) / 2.
struct Reduced {
  cv::Mat gray;  // CV_8UC1
  double step = 1;
  cv::Point2d origin;
};

// `around` is cut to the image; where nothing is left the whole image is taken.
void reduce(const cv::Mat& gray, const cv::Rect& around, double scale, Reduced& out);

// log(1 + i) for i = 0..255.
[[nodiscard]] const float* log_table();

// 1 / norm of the window without its mean, for each place of a side x side window in `logs`
// (CV_32FC1; its last `spare` columns do not count), into `out` (rows - side + 1, cols - spare -
// side + 1). 0 where the window is flat. `scratch` is a buffer of doubles.
void inverse_norms(const cv::Mat& logs, int spare, int side, cv::Mat& scratch, cv::Mat& out);

// Correlation of `patch` (continuous, side x side) with `in` at rows x cols places: `in` must be
// readable to (rows + side - 1) rows of (cols + side - 1 + kOverread) floats, `out` writable to
// cols + kOverread floats a row, of which the last ones are rubbish.
void correlate(const float* in, std::size_t in_stride, const float* patch, int side, int rows,
               int cols, float* out, std::size_t out_stride);

// Width of the mean shape.
[[nodiscard]] double width_of(const Eigen::Matrix2Xd& points);

// Where the peak of a parabola through three neighbours lies, -0.5..0.5 from the middle one.
[[nodiscard]] double parabola_peak(double left, double middle, double right);

}  // namespace tarsier::face::landmarks::detail
