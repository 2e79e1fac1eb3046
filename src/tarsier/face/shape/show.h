// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/shape_model.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::shape {

struct LandmarkStyle {
  double radius_px = 0;  // 0: fits the image
  bool numbers = false;  // index beside each point
  bool connections = true;
  bool symmetry = false;     // left and right points (as `mirror` has them) in different colours
  std::vector<bool> hidden;  // points that are drawn as rings; empty: none
  // px, of each point: the radius of its ring, at least that of a ring of unknown deviation; empty: not known.
  Eigen::VectorXd sigma_px;
  bool all_sigmas = false;  // thin circles of this radius around the other points, too
};

// Points, connections and symmetry drawn on an image (CV_8UC3), anti-aliased, sub-pixel. Missing
// points and their lines are left out.
void draw_landmarks(cv::Mat& image, const Eigen::Matrix2Xd& points,
                    const std::vector<std::array<int, 2>>& connections,
                    const std::vector<int>& mirror, const LandmarkStyle& style = {});

// The samples as a sheet of thumbnails with their points, each cut out around its points with a
// margin; `columns` <= 0: as many as make it 4:3. Images that cannot be read get a dark cell with
// the reason. Cells are `cell_px` wide and high; at most `most` samples.
[[nodiscard]] cv::Mat contact_sheet(const LandmarkSet& set, const std::string& set_path,
                                    int cell_px, int columns, int most, const LandmarkStyle& style);

// One frame of the animation of a mode: mean + value * deviation along it, drawn on `background`
// grey-blue with its connections; the mean faint behind it; title and a bar for the value. The
// scale is such that all modes at +-3 sigma fit.
[[nodiscard]] cv::Mat draw_shape(const ShapeModel& model, const Eigen::VectorXd& b, cv::Size size,
                                 const std::string& title);

// A strip: one row a mode (at most `modes`), columns at -3, -1.5, 0, 1.5, 3 sigma.
[[nodiscard]] cv::Mat draw_modes(const ShapeModel& model, int modes, int cell_px);

// Frames of the animation: each mode in turn from 0 to +3, to -3, and back.
[[nodiscard]] std::vector<cv::Mat> animate_modes(const ShapeModel& model, int modes, cv::Size size,
                                                 int frames_per_mode);

}  // namespace tarsier::face::shape
