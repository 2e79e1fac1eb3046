// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// The unit of a model, from markers of known size in the scene.
namespace tarsier::sfm {

// A marker detected in an image, by any detector.
struct DetectedMarker {
  int id = 0;
  std::array<Eigen::Vector2d, 4> corners;  // px, clockwise from the marker's own top left corner
};
// Detects the markers of an image (CV_8UC1), in any order.
using MarkerFinder = std::function<std::vector<DetectedMarker>(const cv::Mat& gray)>;

struct KnownMarkers {
  double side = 0;     // > 0, in any unit; this becomes the model's unit
  MarkerFinder find;   // e.g. planar::markers::detect_markers(), of one family
  void check() const;  // throws std::invalid_argument
};

struct MarkerScale {
  double scale = 1;  // units of `side` per unit of the model
  int markers = 0;   // used for the scale
  int left_out = 0;  // markers whose corners do not form a square
  int images = 0;    // images that show a used marker
  // largest deviation of a marker's side from the median, as a share of the median
  double spread = 0;
};
// {"scale", "markers", "left_out", "images", "spread"}
[[nodiscard]] nlohmann::ordered_json to_json(const MarkerScale& scale);

// Detects the markers in the registered images, triangulates their corners with the poses of the
// model (triangulation.h) and compares their sides with the known side: scale = side / median of
// the markers' mean sides. The model is not changed.
//
// A marker is used where two or more images see it under rays at least 3 degrees apart. Images in
// which a corner has a reprojection error above 3 px are left out, but fewer than half of a
// marker's images. A marker is left out where more images would have to go (e.g. an id that is in
// the scene twice), or where its sides or diagonals differ by more than 10 %.
//
// `path_of` returns the file of an image of the model. Throws Error (kInput) where no marker can
// be used, InputError for an image that cannot be read or whose size differs from its camera's,
// Interrupted.
[[nodiscard]] MarkerScale marker_scale(
    const Model& model, const std::function<std::string(const std::string& name)>& path_of,
    const KnownMarkers& known, Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
