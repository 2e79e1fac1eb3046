// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/regression/patches.h"
#include "tarsier/face/shape/similarity.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

// Functions shared by training, fitting and drawing of patches. Internal to this module.
namespace tarsier::face::regression::detail {

// Correlations read up to this number of floats beyond the right end of their input.
inline constexpr int kOverread = 8;

// Part of an image, reduced by an integer factor (box averages), so that bilinear sampling with a
// step of about `scale` image pixels does not alias. Pixel (u, v) of `gray` is at origin + step *
// (u, v) in the image; with box averages, the origin includes (step - 1) / 2.
struct Reduced {
  cv::Mat gray;  // CV_8UC1
  double step = 1;
  cv::Point2d origin;
};

// `around` is clipped to the image; if nothing remains, the whole image is used.
void reduce(const cv::Mat& gray, const cv::Rect& around, double scale, Reduced& out);

// log(1 + i) for i = 0..255.
[[nodiscard]] const float* log_table();

// 1 / norm of the window minus its mean, for each position of a side x side window in `logs`
// (CV_32FC1; its last `spare` columns are ignored), into `out` (rows - side + 1, cols - spare -
// side + 1). 0 for a flat window. `scratch` is a buffer of doubles.
void inverse_norms(const cv::Mat& logs, int spare, int side, cv::Mat& scratch, cv::Mat& out);

// Correlation of `patch` (continuous, side x side) with `in` at rows x cols positions. `in` must be
// readable for (rows + side - 1) rows of (cols + side - 1 + kOverread) floats. `out` must be
// writable for cols + kOverread floats per row; the last ones are invalid.
void correlate(const float* in, std::size_t in_stride, const float* patch, int side, int rows,
               int cols, float* out, std::size_t out_stride);

// Width of the mean shape.
[[nodiscard]] double width_of(const Eigen::Matrix2Xd& points);

// Peak of a parabola through three neighbours, -0.5..0.5 from the center one.
[[nodiscard]] double parabola_peak(double left, double center, double right);

}  // namespace tarsier::face::regression::detail
