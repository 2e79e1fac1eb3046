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
  int radial = 3;              // radial numbers of a pinhole that are looked for
  bool tangential = true;      // p1, p2, of pinhole and rational
  bool square_pixels = false;  // fy = fx
  // A view whose RMS is more than this many times the median of all views', and at least
  // outlier_px, does not fit and is left out.
  double outlier = 3;
  double outlier_px = 0.5;  // px
  int min_views = 3;        // that differ
  // Where to begin, of the same lens: a session that gains a view need not search again. Where the
  // views do not fit it (rms above 2 px), it is searched for all the same.
  std::optional<geometry::Camera> start;

  [[nodiscard]] OptionFields fields() {
    return {{"radial", radial, range(0, 3), "--radial",
             "radial numbers of a pinhole; fewer for few views"},
            {"outlier", outlier, range(2, 1e6), "--outlier",
             "a view that fits so many times worse than most is left out"},
            {"outlier_px", outlier_px, at_least(0)},
            {"min_views", min_views, at_least(2)}};
  }
  void check() const { check_fields(*this); }
};

enum class ViewState { kUsed, kNoPose, kOutlier };

struct ViewReport {
  ViewState state = ViewState::kUsed;
  geometry::Rigid3 camera_from_board;  // m; of kNoPose: the identity
  double rms = 0;       // px, of the points that count; also of views that were left out
  int dropped = 0;      // points that do not fit, of a view whose others do
  double tilt_deg = 0;  // between the board's normal and the line of sight to it
};

// One standard deviation of each number of the camera, as the scatter of the corners gives it (the
// diagonal of sigma2 (J^T J)^-1 with the poses eliminated); infinite where the views fix none.
struct Deviations {
  double fx = 0;  // px
  double fy = 0;
  double cx = 0;
  double cy = 0;
  std::array<double, 8> distortion{};
};

struct Calibration {
  geometry::Camera camera;  // its rms: over all points of used views
  Deviations deviations;
  std::vector<ViewReport> views;  // one for each given
  int used = 0;                   // views
  std::string refusal;            // why there is no camera, and what to do; empty: there is one
  std::vector<std::string> warnings;

  [[nodiscard]] bool ok() const { return refusal.empty(); }
};

// The camera that took the views (images of `size` px): Zhang's calibration from a plane (PAMI
// 2000) with the lens models of geometry::Camera. Start: the best of several focal lengths, each
// with poses from IPPE; then Levenberg-Marquardt over everything, first with Huber's loss so that
// a wrong view cannot pull, then without the views that do not fit. Minimises the squared distance
// in the image; the pixels of dots are corrected for the middle of a dot's image not being the
// image of its middle. RMS as OpenCV has it: the root of the mean of dx2 + dy2.
// Refused (see refusal): fewer than min_views views, views that are all alike or show the board
// from one direction, and whatever else leaves a focal length uncertain by more than 3 % or the
// principal point by 3 % of the image for corners that are good to 0.1 px. Throws
// std::invalid_argument, Interrupted. The same views give the same camera, whatever the threads.
[[nodiscard]] Calibration calibrate(const std::vector<BoardView>& views, const BoardSpec& spec,
                                    cv::Size size, const CalibrateOptions& options = {},
                                    const std::stop_token& stop = {});

}  // namespace tarsier::planar::calibration
