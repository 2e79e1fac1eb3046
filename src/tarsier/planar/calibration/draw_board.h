// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/coverage.h"

#include <opencv2/core/mat.hpp>

namespace tarsier::planar::calibration {

// Draws the view's points on its image (CV_8UC3): coloured by row, connected in the board's order,
// with a ring around the first.
void draw_view(cv::Mat& image, const BoardView& view, const BoardSpec& spec);

// Draws the projections of the points by `camera`, and the reprojection error of each point,
// enlarged `scale` times.
void draw_errors(cv::Mat& image, const BoardView& view, const BoardSpec& spec,
                 const geometry::Camera& camera, const geometry::Rigid3& camera_from_board,
                 double scale);

// Tints the cells that views touched green, stronger for more views, and the other cells red.
void draw_coverage(cv::Mat& image, const Coverage& coverage, double opacity = 0.35);

// Draws the points of all views, coloured by view, over the cells; `width` px wide.
[[nodiscard]] cv::Mat coverage_image(const std::vector<BoardView>& views, const Coverage& coverage,
                                     int width);

}  // namespace tarsier::planar::calibration
