// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/marker_scale.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/scene/sensor_image.h"
#include "tarsier/sfm/two_view/triangulation.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr double kMinRayAngle_rad = 3 * std::numbers::pi / 180;
constexpr double kMaxReprojection = 3;  // px
constexpr double kMaxSpread = 0.05;     // share of a marker's side, above which a warning is given
// max relative difference of the sides, and of the diagonals, of a square
constexpr double kMaxSideDifference = 0.10;

struct MarkerObservation {
  int image = 0;  // index into Model::images
  std::array<Eigen::Vector2d, 4> corners;
};
using MarkerObservations = std::map<int, std::vector<MarkerObservation>>;  // by id

using Square = std::array<Eigen::Vector3d, 4>;  // world

// An id that occurs twice in an image is ignored there.
void add_observations(const std::vector<DetectedMarker>& markers, int image,
                      MarkerObservations& by_id) {
  for (const DetectedMarker& marker : markers) {
    const auto same = std::count_if(markers.begin(), markers.end(),
                                    [&](const auto& other) { return other.id == marker.id; });
    if (same == 1) by_id[marker.id].push_back({image, marker.corners});
  }
}

MarkerObservations find_markers(const Model& model,
                                const std::function<std::string(const std::string&)>& path_of,
                                const MarkerFinder& find, Progress& progress,
                                const std::stop_token& stop) {
  MarkerObservations by_id;
  const auto registered = std::count_if(model.images.begin(), model.images.end(),
                                        [](const Image& image) { return image.registered; });
  progress.begin("markers", registered, "images");
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const Image& image = model.images[i];
    if (!image.registered) continue;
    throw_if_stopped(stop);
    const std::string path = path_of(image.name);
    const cv::Mat gray = read_sensor_gray_image(path);
    const geometry::Camera& camera = model.cameras[static_cast<std::size_t>(image.camera)];
    if (gray.size() != cv::Size(camera.width, camera.height)) {
      throw InputError(
          path, fmt::format("the image has {}x{} px, but its camera in the model has {}x{} px",
                            gray.cols, gray.rows, camera.width, camera.height));
    }
    add_observations(find(gray), static_cast<int>(i), by_id);
    progress.advance();
  }
  progress.end();
  return by_id;
}

// Whether two of the cameras see the point under a large enough angle.
bool has_wide_baseline(const Model& model, const std::vector<MarkerObservation>& observations,
                       const Eigen::Vector3d& point) {
  const auto center = [&](const MarkerObservation& one) {
    return model.images[static_cast<std::size_t>(one.image)].pose.center();
  };
  for (std::size_t a = 0; a < observations.size(); ++a)
    for (std::size_t b = a + 1; b < observations.size(); ++b)
      if (ray_angle(point, center(observations[a]), center(observations[b])) >= kMinRayAngle_rad)
        return true;
  return false;
}

enum class SideStatus { kMeasured, kSmallAngle, kNotSquare };

// Triangulates a corner of a marker from all images that show it; empty where that fails.
std::optional<Eigen::Vector3d> corner_of(const Model& model,
                                         const std::vector<MarkerObservation>& observations,
                                         std::size_t corner) {
  std::vector<ObservationRay> rays;
  for (const MarkerObservation& one : observations) {
    const Image& image = model.images[static_cast<std::size_t>(one.image)];
    const geometry::Camera& camera = model.cameras[static_cast<std::size_t>(image.camera)];
    const Eigen::Vector2d& pixel = one.corners[corner];
    const auto ray = camera.normalized_of({pixel.x(), pixel.y()});
    if (!ray) return std::nullopt;
    rays.push_back({image.pose, *ray});
  }
  return triangulate(rays);
}

// The largest reprojection error of the corners in an image, px.
double reprojection_of(const Model& model, const MarkerObservation& observation,
                       const Square& corners) {
  const Image& image = model.images[static_cast<std::size_t>(observation.image)];
  const geometry::Camera& camera = model.cameras[static_cast<std::size_t>(image.camera)];
  double max_error = 0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const auto pixel = camera.project(image.pose * corners[k]);
    if (!pixel) return HUGE_VAL;
    max_error =
        std::max(max_error, (Eigen::Vector2d(pixel->x, pixel->y) - observation.corners[k]).norm());
  }
  return max_error;
}

// The mean side; 0 where the sides or the diagonals differ too much.
double side_of(const Square& corners) {
  std::array<double, 4> sides{};
  for (std::size_t k = 0; k < 4; ++k) sides[k] = (corners[(k + 1) % 4] - corners[k]).norm();
  const double mean = (sides[0] + sides[1] + sides[2] + sides[3]) / 4;
  const double first = (corners[2] - corners[0]).norm();
  const double second = (corners[3] - corners[1]).norm();
  const auto [shortest, longest] = std::minmax_element(sides.begin(), sides.end());
  const bool is_square = *longest - *shortest <= kMaxSideDifference * mean &&
                         std::abs(first - second) <= kMaxSideDifference * std::max(first, second);
  return is_square ? mean : 0;
}

// Measures the side of a marker, in units of the model. The worst images are removed from
// `observations`, but fewer than half.
SideStatus measure(const Model& model, std::vector<MarkerObservation>& observations, double& side) {
  const std::size_t all = observations.size();
  while (observations.size() >= 2) {
    Square corners;
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const auto point = corner_of(model, observations, k);
      if (!point) return SideStatus::kNotSquare;
      corners[k] = *point;
    }
    if (!has_wide_baseline(model, observations, corners[0])) return SideStatus::kSmallAngle;
    std::vector<double> errors;
    errors.reserve(observations.size());
    for (const MarkerObservation& one : observations)
      errors.push_back(reprojection_of(model, one, corners));
    const auto max_error = std::max_element(errors.begin(), errors.end());
    if (*max_error <= kMaxReprojection) {
      side = side_of(corners);
      return side > 0 ? SideStatus::kMeasured : SideStatus::kNotSquare;
    }
    if (2 * (observations.size() - 1) <= all) return SideStatus::kNotSquare;
    observations.erase(observations.begin() + (max_error - errors.begin()));
  }
  return SideStatus::kSmallAngle;
}

}  // namespace

void KnownMarkers::check() const {
  TARSIER_REQUIRE(side > 0 && std::isfinite(side), "marker side {}: expected above 0", side);
  TARSIER_REQUIRE(find != nullptr, "no function that detects markers");
}

nlohmann::ordered_json to_json(const MarkerScale& scale) {
  return {{"scale", scale.scale},
          {"markers", scale.markers},
          {"left_out", scale.left_out},
          {"images", scale.images},
          {"spread", scale.spread}};
}

MarkerScale marker_scale(const Model& model,
                         const std::function<std::string(const std::string& name)>& path_of,
                         const KnownMarkers& known, Progress& progress,
                         const std::stop_token& stop) {
  known.check();
  MarkerObservations by_id = find_markers(model, path_of, known.find, progress, stop);
  MarkerScale result;
  std::vector<double> sides;
  std::vector<bool> shows(model.images.size(), false);
  for (auto& [id, observations] : by_id) {
    double side = 0;
    const SideStatus status = measure(model, observations, side);
    if (status == SideStatus::kNotSquare) {
      log_warning(
          "marker {}: its triangulated corners from {} images do not form a square; the marker is "
          "not used",
          id, observations.size());
      ++result.left_out;
    }
    if (status != SideStatus::kMeasured) continue;
    sides.push_back(side);
    for (const MarkerObservation& one : observations)
      shows[static_cast<std::size_t>(one.image)] = true;
  }
  if (sides.empty()) {
    const std::string what = by_id.empty()
                                 ? "no marker was detected in the images of the model"
                                 : fmt::format(
                                       "none of the {} detected markers could be measured: take "
                                       "images of the markers from more different directions",
                                       by_id.size());
    throw Error(ErrorKind::kInput, "scale from markers: " + what);
  }
  const double median_side = upper_median(sides);
  result.scale = known.side / median_side;
  result.markers = static_cast<int>(sides.size());
  result.images = static_cast<int>(std::count(shows.begin(), shows.end(), true));
  for (const double side : sides)
    result.spread = std::max(result.spread, std::abs(side / median_side - 1));
  if (result.spread > kMaxSpread) {
    log_warning("the sides of the {} markers differ by up to {:.0f} %: use markers of one size",
                result.markers, 100 * result.spread);
  }
  return result;
}

}  // namespace tarsier::sfm
