// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/options.h"
#include "tarsier/cartoon/plane.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <array>
#include <vector>

// Segments skin and changes its colour, all at half size.
namespace tarsier::cartoon {

// Six points (forehead and cheeks) of a face that fills the outline, in an image of this size.
[[nodiscard]] std::array<cv::Point, 6> skin_seeds(cv::Size size);

// Buffers of find_skin, reused from frame to frame.
struct SkinBuffers {
  cv::Mat ycrcb;
  cv::Mat flood_mask;  // 2 px larger than the image in each direction
  cv::Mat edges;
  cv::Mat weight;  // for smooth_skin
  cv::Mat large_weight;
  Plane soft_weight;                      // blurred
  std::vector<AlignedBytes> weight_rows;  // at full size, one per band of rows
};

// Segments skin by flood fill from skin_seeds over `painting` (CV_8UC3), bounded by the edges of
// the 8-bit Laplacian response `response` (CV_8UC1, the size of the frame). The result is CV_8UC1
// of the size of `painting`, 0 or 1; it is stored in `buffers`.
[[nodiscard]] cv::Mat find_skin(const cv::Mat& painting, const cv::Mat& response,
                                const SkinOptions& options, SkinBuffers& buffers);

// Skin colour of one person: a Gaussian in (Cr, Cb).
struct SkinColor {
  cv::Vec2d mean;
  cv::Matx22d inverse_covariance;
};

// Learns the colour from the centre of `face` (px of `ycrcb`, CV_8UC3): cheeks and nose. Robust to
// eyes and glasses.
[[nodiscard]] SkinColor learn_skin_color(const cv::Mat& ycrcb, const cv::Rect& face);

// Segments the skin of several faces: the pixels around each face (head, neck) whose colour is
// within options.learned_distance of that face's colour. `faces` in px of `painting`. Result as for
// find_skin.
[[nodiscard]] cv::Mat find_skin_of_faces(const cv::Mat& painting,
                                         const std::vector<cv::Rect>& faces,
                                         const std::vector<SkinColor>& colors,
                                         const SkinOptions& options, SkinBuffers& buffers);

// Changes the skin of `painting` in place, according to options.style and options.color.
void color_skin(cv::Mat& painting, const cv::Mat& skin, const SkinOptions& options);

// The part of the half-size image that smooth_skin may change: around the skin, with room for the
// feathered edge. Empty if there is no skin.
[[nodiscard]] cv::Rect smoothed_area(const cv::Mat& skin);

// Writes to `result` the `frame` with its skin replaced by `enlarged`, the painting at full size
// (all CV_8UC3). The transition is feathered: skin is smooth, everything else stays sharp. `skin`
// is at half size, 0 or 1. If the frame is exactly twice as large as `skin`, only twice
// smoothed_area(skin) of `enlarged` is read.
void smooth_skin(const cv::Mat& frame, const cv::Mat& enlarged, const cv::Mat& skin,
                 SkinBuffers& buffers, cv::Mat& result);

}  // namespace tarsier::cartoon
