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

// The unit of a model by markers of a known size that lie in the scene.
namespace tarsier::sfm {

// A marker in an image, whatever found it.
struct SeenMarker {
  int id = 0;
  std::array<Eigen::Vector2d, 4> corners;  // px, the marker's own top left first, clockwise
};
// The markers of an image (CV_8UC1), in any order.
using FindMarkers = std::function<std::vector<SeenMarker>(const cv::Mat& gray)>;

struct KnownMarkers {
  double side = 0;     // in any unit: the model's from then on; above 0
  FindMarkers find;    // e.g. by planar::markers::detect_markers(), of one family
  void check() const;  // throws std::invalid_argument
};

struct MarkerScale {
  double scale = 1;   // units of `side` for one of the model
  int markers = 0;    // that tell it
  int left_out = 0;   // markers whose corners make no square
  int images = 0;     // in which the markers were seen
  double spread = 0;  // largest deviation of a marker's side from the median, a share of it
};
// {"scale", "markers", "left_out", "images", "spread"}
[[nodiscard]] nlohmann::ordered_json to_json(const MarkerScale& scale);

// Finds the markers in the registered images of the model, triangulates their corners from its
// poses (triangulation.h) and compares the sides with the known one: scale = side / median of the
// markers' mean sides. The model stays as it is.
//
// A marker counts that two or more images show under rays at least 3 degrees apart. Images in which
// a corner lies more than 3 px from its reprojection are left out, fewer than half of a marker's; the
// marker is left out where more are (an id that is in the scene twice), or where its sides or
// diagonals differ by more than 10 %.
//
// `path_of`: the file of an image of the model. Throws Error (kBadInput) where no marker is left,
// InputError for an image that cannot be read or is of another size than its camera, Interrupted.
[[nodiscard]] MarkerScale marker_scale(
    const Model& model, const std::function<std::string(const std::string& name)>& path_of,
    const KnownMarkers& known, Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
