// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/coverage.h"

#include <opencv2/core/mat.hpp>

namespace tarsier::planar::calibration {

// Draws the view's points on its image (CV_8UC3), row by row in colours, joined in the board's
// order, a ring around the first.
void draw_view(cv::Mat& image, const BoardView& view, const BoardSpec& spec);

// Where `camera` says the points are, and `scale` times the way to where they were found: what
// is left of each point.
void draw_errors(cv::Mat& image, const BoardView& view, const BoardSpec& spec,
                 const geometry::Camera& camera, const geometry::Rigid3& camera_from_board,
                 double scale);

// Tints the cells of the image that views touched (green, stronger for more), and leaves the
// others red.
void draw_coverage(cv::Mat& image, const Coverage& coverage, double opacity = 0.35);

// An image of all views' points, coloured by view, over the cells: `width` px wide.
[[nodiscard]] cv::Mat coverage_image(const std::vector<BoardView>& views, const Coverage& coverage,
                                     int width);

}  // namespace tarsier::planar::calibration
