// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/options.h"
#include "tarsier/cartoon/plane.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <array>
#include <vector>

// Where skin is, and how its colour is changed; all at half size.
namespace tarsier::cartoon {

// Six points of a face that fills the outline, in an image of this size: forehead and cheeks.
[[nodiscard]] std::array<cv::Point, 6> skin_seeds(cv::Size size);

// Buffers of find_skin, reused between frames.
struct SkinBuffers {
  cv::Mat ycrcb;
  cv::Mat flood_mask;  // two larger than the image
  cv::Mat edges;
  cv::Mat weight;  // of smooth_skin
  cv::Mat large_weight;
  Plane soft_weight;                      // blurred
  std::vector<AlignedBytes> weight_rows;  // at full size, one for each band of rows
};

// Skin by flood fill from skin_seeds over `painting` (CV_8UC3), bounded by the edges of the 8-bit
// Laplacian response `response` (CV_8UC1, the size of the frame). Result: CV_8UC1 of painting's
// size, 0 or 1; lives in `buffers`.
[[nodiscard]] cv::Mat find_skin(const cv::Mat& painting, const cv::Mat& response,
                                const SkinOptions& options, SkinBuffers& buffers);

// Colour of one person's skin: a Gaussian in (Cr, Cb).
struct SkinColor {
  cv::Vec2d mean;
  cv::Matx22d inverse_covariance;
};

// Learns it from the middle of `face` (px in `ycrcb`, CV_8UC3): cheeks and nose, robust to eyes and
// glasses.
[[nodiscard]] SkinColor learn_skin_color(const cv::Mat& ycrcb, const cv::Rect& face);

// Skin of several faces: pixels around each face (head, neck) whose colour is within
// options.learned_distance of that face's. `faces` in px of `painting`. Result as find_skin.
[[nodiscard]] cv::Mat find_skin_of_faces(const cv::Mat& painting,
                                         const std::vector<cv::Rect>& faces,
                                         const std::vector<SkinColor>& colors,
                                         const SkinOptions& options, SkinBuffers& buffers);

// Changes the skin of `painting` in place, as options.style and options.color say.
void color_skin(cv::Mat& painting, const cv::Mat& skin, const SkinOptions& options);

// The part of the half-size image in which smooth_skin may change anything: around the skin, with
// room for the feather. Empty where there is no skin.
[[nodiscard]] cv::Rect smoothed_area(const cv::Mat& skin);

// `frame` with its skin replaced by `enlarged`, the painting at full size, into `result` (all
// CV_8UC3); the transition is feathered: smooth skin, sharp everything else. `skin` is at half
// size, 0 or 1. If the frame is exactly twice as large as `skin`, only twice smoothed_area(skin) of
// `enlarged` is looked at.
void smooth_skin(const cv::Mat& frame, const cv::Mat& enlarged, const cv::Mat& skin,
                 SkinBuffers& buffers, cv::Mat& result);

}  // namespace tarsier::cartoon
