// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/calibration/board.h"

#include <opencv2/core/mat.hpp>

#include <optional>
#include <string>
#include <vector>

namespace tarsier::planar::calibration {

// A board in one image: the visible points and their pixels.
struct BoardView {
  std::vector<int> points;          // indices for BoardSpec::point, ascending
  std::vector<cv::Point2f> pixels;  // px, pixel centres at integers
  [[nodiscard]] bool empty() const { return points.empty(); }
};

struct FindOptions {
  // Larger side of the image for the first search, px. It bounds the time, because searching a
  // large image without a board takes seconds.
  int search_px = 800;
  // If the first search fails, searches again with evened light and with another method.
  bool retry = true;
  // The first search uses evened light (local means and deviations removed).
  bool even_light = false;
  // Charuco: minimum number of corners of a view.
  int min_corners = 6;

  [[nodiscard]] OptionFields fields() {
    return {{"search_px", search_px, range(160, 4000)}, {"min_corners", min_corners, at_least(4)}};
  }
  void check() const { check_fields(*this); }
};

// Finds the board in an image.
//
// Chess boards: the detector of Duda and Frese (BMVC 2018, cv::findChessboardCornersSB) on the
// reduced image. If `retry`, the same again with evened light, then cv::findChessboardCorners
// without its adaptive thresholds, which take seconds for a board of another size. A part of a
// larger board does not count. The corners are then refined to the saddle point in the full image
// (cv::cornerSubPix), in windows of at most 0.4 squares, so that neighbouring corners have no
// influence.
//
// Charuco: Tarsier's own detector finds the markers. Their homographies predict the corners, which
// are refined in the same way. A part of the board is enough.
//
// Dots: cv::findCirclesGrid on a limited number of blobs.
//
// `image` is 8-bit grey or BGR, not empty. The view is empty if there is no (whole) board, or if
// the image is smaller than 16 px in one direction.
[[nodiscard]] BoardView find_board(const cv::Mat& image, const BoardSpec& spec,
                                   const FindOptions& options = {});

// Sharpness of the image at the view's points, 1/px: the maximum slope of the edge divided by its
// height, averaged (an edge w px wide has about 1/w). 0 for dots and empty views.
[[nodiscard]] double sharpness_of(const cv::Mat& image, const BoardView& view,
                                  const BoardSpec& spec);

// For the case that no image shows the board: chess boards of similar sizes that this image shows,
// nearest size first ("8x6"). Empty if there are none. Slow (many searches).
[[nodiscard]] std::vector<std::string> other_chess_sizes(const cv::Mat& image,
                                                         const BoardSpec& spec);

}  // namespace tarsier::planar::calibration
