// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/markers/pose.h"

#include <opencv2/core.hpp>

#include <array>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Compares detected markers with the ground truth. Image targets are evaluated in the same way.
namespace tarsier::planar::markers {

// A true or a detected marker. Corners: px, the marker's own top left first, clockwise. Pose:
// camera from marker, in the unit of the truth.
struct MarkerRecord {
  int id = 0;
  std::array<cv::Point2d, 4> corners;
  std::optional<geometry::Rigid3> pose;
  double side_px = 50;  // of a true marker
};
// Converts a detected marker; without a pose if none is given.
[[nodiscard]] MarkerRecord record_of(const Marker& marker,
                                     const std::optional<MarkerPose>& pose = {});

// One image of a truth file.
struct MarkerTruth {
  std::string image;   // path relative to the truth file's folder
  std::string family;  // empty if the markers are image targets
  std::string target;  // the target image, path relative to the truth file's folder
  std::string level;
  geometry::Camera camera;  // without a size
  double size = 0;          // m, side of the markers or width of the target image; 0: unknown
  std::vector<MarkerRecord> markers;
};

// Reads a file of JSON lines {"image", "family" or "target", "K" (9 numbers), "dist" (up to 8),
// "size", "level", "markers": [{"id", "corners", "rvec", "tvec", "side_px"}]}. Throws InputError,
// which names the line, for another format.
[[nodiscard]] std::vector<MarkerTruth> read_marker_truth(const std::string& path);

struct ImageDetections {
  std::vector<MarkerRecord> markers;
  std::optional<double> ms;
};
// Reads result lines {"image", "markers": [..], "ms"}; keyed by image. Throws InputError as above.
[[nodiscard]] std::map<std::string, ImageDetections> read_detected_markers(const std::string& path);

struct MarkerScore {
  int images = 0;
  int truth = 0;            // true markers
  int true_positives = 0;   // of these, the detected ones
  int false_positives = 0;  // false detections, or with a wrong id
  int rotated = 0;          // of the false ones: the right marker with its corners in another order
  // Per-marker root mean square, median.
  double corner_px = std::numeric_limits<double>::quiet_NaN();
  double corner_px_p95 = std::numeric_limits<double>::quiet_NaN();  // 95th percentile
  double rotation_deg = std::numeric_limits<double>::quiet_NaN();
  double rotation_deg_p95 = std::numeric_limits<double>::quiet_NaN();
  // Rotation errors above 15 degrees.
  double flips_percent = std::numeric_limits<double>::quiet_NaN();
  double distance_percent = std::numeric_limits<double>::quiet_NaN();  // |t - t*| / |t*|, median
  double ms = std::numeric_limits<double>::quiet_NaN();                // median over images
  std::map<std::string, std::pair<int, int>> levels;                   // true positives, true

  [[nodiscard]] double recall() const { return truth > 0 ? 1.0 * true_positives / truth : 1; }
  [[nodiscard]] double precision() const {
    const int detections = true_positives + false_positives;
    return detections > 0 ? 1.0 * true_positives / detections : 1;
  }
};

// Accumulates the scores of images. A detection is correct if its id is that of a true marker that
// is not matched yet and the mean distance of the corners, in order, is below max(3 px, `tolerance`
// * side).
class MarkerEvaluator {
 public:
  explicit MarkerEvaluator(double tolerance = 0.2) : tolerance_(tolerance) {}
  void add(const MarkerTruth& truth, std::span<const MarkerRecord> found, std::optional<double> ms);
  [[nodiscard]] MarkerScore score() const;

 private:
  double tolerance_;
  MarkerScore counts_;
  std::vector<double> corner_px_;
  std::vector<double> rotation_deg_;
  std::vector<double> distance_percent_;
  std::vector<double> ms_;
};

}  // namespace tarsier::planar::markers
