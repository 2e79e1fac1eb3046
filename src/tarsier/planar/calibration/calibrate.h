// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/calibration/board.h"
#include "tarsier/planar/calibration/detect.h"

#include <array>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::planar::calibration {

struct CalibrateOptions {
  geometry::Lens lens = geometry::Lens::kPinhole;
  int radial = 3;              // number of estimated radial coefficients of a pinhole camera
  bool tangential = true;      // estimates p1, p2 of pinhole and rational
  bool square_pixels = false;  // fy = fx
  // A view is an outlier if its RMS is more than `outlier` times the median of all views and at
  // least outlier_px. Outliers are not used.
  double outlier = 3;
  double outlier_px = 0.5;  // px
  int min_views = 3;        // minimum number of different views
  // Initial camera with the same lens; it saves the search when a session gains a view. If it does
  // not fit the views (rms above 2 px), the search is made nevertheless.
  std::optional<geometry::Camera> start;

  [[nodiscard]] OptionFields fields() {
    return {{"radial", radial, range(0, 3), "--radial",
             "number of radial coefficients of a pinhole lens; fewer for few views"},
            {"outlier", outlier, range(2, 1e6), "--outlier",
             "reject views whose error exceeds the typical one by this factor"},
            {"outlier_px", outlier_px, at_least(0)},
            {"min_views", min_views, at_least(2)}};
  }
  void check() const { check_fields(*this); }
};

enum class ViewState { kUsed, kNoPose, kOutlier };

struct ViewReport {
  ViewState state = ViewState::kUsed;
  geometry::Rigid3 camera_from_board;  // m; identity for kNoPose
  double rms = 0;                      // px, of the points used; also given for outlier views
  int dropped = 0;                     // outlier points of a used view
  double tilt_deg = 0;                 // angle between the board's normal and the line of sight
};

// One standard deviation of each parameter of the camera, from the scatter of the corners (the
// diagonal of sigma2 (J^T J)^-1 with the poses eliminated). Infinite if the views do not determine
// it.
struct Deviations {
  double fx = 0;  // px
  double fy = 0;
  double cx = 0;
  double cy = 0;
  std::array<double, 8> distortion{};
};

struct Calibration {
  geometry::Camera camera;  // its rms is over all points of the used views
  Deviations deviations;
  std::vector<ViewReport> views;  // one for each input view
  int used = 0;                   // number of used views
  std::string refusal;            // why there is no camera, and what to do; empty if there is one
  std::vector<std::string> warnings;

  [[nodiscard]] bool ok() const { return refusal.empty(); }
};

// Calibrates the camera that took the views (images of `size` px): Zhang's calibration from a plane
// (PAMI 2000) with the lens models of geometry::Camera. The initial camera is the best of several
// focal lengths, each with poses from IPPE. Then Levenberg-Marquardt refines all parameters, first
// with Huber's loss so that a wrong view has little influence, then without the outlier views. It
// minimises the squared reprojection error. For dots, the pixels are corrected because the centre
// of a dot's image is not the image of its centre. The RMS is that of OpenCV: the root of the mean
// of dx2 + dy2.
// There is no camera (see refusal) if there are fewer than min_views views, or if all views are
// alike or show the board from one direction. The same holds if, for corners accurate to 0.1 px, a
// focal length is uncertain by more than 3 % or the principal point by more than 3 % of the image.
// Throws std::invalid_argument, Interrupted. The result does not depend on the number of threads.
[[nodiscard]] Calibration calibrate(const std::vector<BoardView>& views, const BoardSpec& spec,
                                    cv::Size size, const CalibrateOptions& options = {},
                                    const std::stop_token& stop = {});

}  // namespace tarsier::planar::calibration
