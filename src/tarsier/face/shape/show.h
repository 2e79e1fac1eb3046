// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/shape_model.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::shape {

struct LandmarkStyle {
  double radius_px = 0;  // 0: chosen for the image
  bool numbers = false;  // index next to each point
  bool connections = true;
  bool symmetry = false;     // left and right points (by `mirror`) in different colours
  std::vector<bool> hidden;  // points that are drawn as rings; empty: none
  // px, for each point: radius of its ring, at least that of a ring of unknown deviation; empty:
  // unknown.
  Eigen::VectorXd sigma_px;
  bool all_sigmas = false;  // also thin circles of this radius around the other points
};

// Draws points, connections and symmetry on an image (CV_8UC3), anti-aliased, with sub-pixel
// accuracy. Missing points and their lines are omitted.
void draw_landmarks(cv::Mat& image, const Eigen::Matrix2Xd& points,
                    const std::vector<std::array<int, 2>>& connections,
                    const std::vector<int>& mirror, const LandmarkStyle& style = {});

// A contact sheet of the samples: thumbnails with points, cropped around the points with a margin.
// `columns` <= 0: chosen for an aspect ratio of 4:3. Unreadable images get a dark cell with the
// reason. Cells are `cell_px` wide and high; at most `max_samples` samples.
[[nodiscard]] cv::Mat contact_sheet(const LandmarkSet& set, const std::string& set_path,
                                    int cell_px, int columns, int max_samples,
                                    const LandmarkStyle& style);

// One frame of the animation of a mode: the shape with its connections on a grey-blue background,
// the mean faintly behind it, a title and a bar for the value. The scale is such that all modes at
// +-3 sigma fit.
[[nodiscard]] cv::Mat draw_shape(const ShapeModel& model, const Eigen::VectorXd& b, cv::Size size,
                                 const std::string& title);

// A grid: one row per mode (at most `modes`), columns at -3, -1.5, 0, 1.5, 3 sigma.
[[nodiscard]] cv::Mat draw_modes(const ShapeModel& model, int modes, int cell_px);

// Frames of the animation: each mode in turn from 0 to +3, to -3, and back.
[[nodiscard]] std::vector<cv::Mat> animate_modes(const ShapeModel& model, int modes, cv::Size size,
                                                 int frames_per_mode);

}  // namespace tarsier::face::shape
