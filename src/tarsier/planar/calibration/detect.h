// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/calibration/board.h"

#include <opencv2/core/mat.hpp>

#include <optional>
#include <string>
#include <vector>

namespace tarsier::planar::calibration {

// A board as one image shows it: points of the board and where they are.
struct BoardView {
  std::vector<int> points;          // BoardSpec::point, ascending
  std::vector<cv::Point2f> pixels;  // px, pixel middles at integers
  [[nodiscard]] bool empty() const { return points.empty(); }
};

struct FindOptions {
  // px, the image's larger side for the first look: in a large image without a board a search
  // takes seconds, in a small one it is bounded.
  int search_px = 800;
  // Further looks where the first one finds nothing: as if the image were evenly lit, and by
  // another method.
  bool patient = true;
  // The first look is as if the image were evenly lit (local means and deviations taken out).
  bool even_light = false;
  // Charuco: fewer corners than this are no view.
  int min_corners = 6;

  [[nodiscard]] OptionFields fields() {
    return {{"search_px", search_px, range(160, 4000)}, {"min_corners", min_corners, at_least(4)}};
  }
  void check() const { check_fields(*this); }
};

// Chess boards: the detector of Duda and Frese (BMVC 2018, cv::findChessboardCornersSB) on the
// reduced image, then (if patient) there again as if it were evenly lit, then
// cv::findChessboardCorners without its adaptive thresholds, which take seconds for a board of
// another size; a part of a larger board is none. Corners are then refined in the full image at
// the saddle point (cv::cornerSubPix), in windows of at most 0.4 squares, so that no neighbour
// pulls. Charuco: markers by tarsier's own detector, their homographies predict the corners,
// refined in the same way; a part of the board is enough. Dots: cv::findCirclesGrid on a bounded
// number of blobs. `image` is 8-bit grey or BGR, not empty. No view where there is no (whole)
// board, nor in images of less than 16 px each way.
[[nodiscard]] BoardView find_board(const cv::Mat& image, const BoardSpec& spec,
                                   const FindOptions& options = {});

// How sharp the image is at the view's points: the mean of the brightness step's steepest part
// over the whole step, 1/px (a step spread over w px has about 1/w). 0 for dots and empty views.
[[nodiscard]] double sharpness_of(const cv::Mat& image, const BoardView& view,
                                  const BoardSpec& spec);

// When no image shows the board: chess boards of other sizes around it that an image shows,
// nearest first ("8x6"); empty: none. Slow (many searches).
[[nodiscard]] std::vector<std::string> other_chess_sizes(const cv::Mat& image,
                                                         const BoardSpec& spec);

}  // namespace tarsier::planar::calibration
