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

// Found markers beside those that are there. Images as targets are judged alike.
namespace tarsier::planar::markers {

// One marker, as it is or as it was found. Corners: px, its own top left first, clockwise. Pose:
// camera from marker, its unit that of the truth.
struct JudgedMarker {
  int id = 0;
  std::array<cv::Point2d, 4> corners;
  std::optional<geometry::Rigid3> pose;
  double side_px = 50;  // of a true one
};
// As it was found; without a pose where none is given.
[[nodiscard]] JudgedMarker judged(const Marker& marker, const std::optional<MarkerPose>& pose = {});

// One image of a truth file.
struct MarkerTruth {
  std::string image;   // as the file has it, relative to the file's folder
  std::string family;  // empty where the markers are images
  std::string target;  // the image, relative to the file's folder
  std::string level;
  geometry::Camera camera;  // without a size
  double size = 0;          // m, of the markers or of the image's width; 0: unknown
  std::vector<JudgedMarker> markers;
};

// Reads a file of JSON lines {"image", "family" or "target", "K" (9 numbers), "dist" (up to 8),
// "size", "level", "markers": [{"id", "corners", "rvec", "tvec", "side_px"}]}. Throws InputError,
// which names the line, for anything else.
[[nodiscard]] std::vector<MarkerTruth> read_marker_truth(const std::string& path);

struct FoundInImage {
  std::vector<JudgedMarker> markers;
  std::optional<double> ms;
};
// Result lines {"image", "markers": [..], "ms"}, by image. Throws InputError as above.
[[nodiscard]] std::map<std::string, FoundInImage> read_found_markers(const std::string& path);

struct MarkerScore {
  int images = 0;
  int truth = 0;   // markers that are there
  int found = 0;   // of these
  int wrong = 0;   // found where none is, or another one
  int turned = 0;  // of the wrong: the right marker with its corners in another order
  double corner_px = std::numeric_limits<double>::quiet_NaN();      // root mean square, median
  double corner_px_p95 = std::numeric_limits<double>::quiet_NaN();  // 95 % are better
  double rotation_deg = std::numeric_limits<double>::quiet_NaN();
  double rotation_deg_p95 = std::numeric_limits<double>::quiet_NaN();
  double flips_percent = std::numeric_limits<double>::quiet_NaN();  // rotations off by > 15 degrees
  double distance_percent = std::numeric_limits<double>::quiet_NaN();  // |t - t*| / |t*|, median
  double ms = std::numeric_limits<double>::quiet_NaN();                // median over images
  std::map<std::string, std::pair<int, int>> levels;                   // found, there

  [[nodiscard]] double recall() const { return truth > 0 ? 1.0 * found / truth : 1; }
  [[nodiscard]] double precision() const {
    return found + wrong > 0 ? 1.0 * found / (found + wrong) : 1;
  }
};

// Sums over images. A found marker counts where the id is that of a true one not yet found and
// the mean distance of its corners, in order, is below max(3 px, `tolerance` * side).
class MarkerJudge {
 public:
  explicit MarkerJudge(double tolerance = 0.2) : tolerance_(tolerance) {}
  void add(const MarkerTruth& truth, std::span<const JudgedMarker> found, std::optional<double> ms);
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
