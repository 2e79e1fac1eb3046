// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/marker_scale.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/mapper/triangulation.h"
#include "tarsier/sfm/scene/sensor_image.h"

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

constexpr double kMinAngle = 3 * std::numbers::pi / 180;
constexpr double kMaxReprojection = 3;  // px
constexpr double kMaxSpread = 0.05;     // share of a marker's side, above which a warning is given
// max relative difference of the sides, and of the diagonals, of a square
constexpr double kMaxDifference = 0.10;

struct Sighting {
  int image = 0;  // index into Model::images
  std::array<Eigen::Vector2d, 4> corners;
};
using Sightings = std::map<int, std::vector<Sighting>>;  // by id

using Square = std::array<Eigen::Vector3d, 4>;  // world

// An id that occurs twice in an image is ignored there.
void add_sightings(const std::vector<SeenMarker>& markers, int image, Sightings& sightings) {
  for (const SeenMarker& marker : markers) {
    const auto same = std::count_if(markers.begin(), markers.end(),
                                    [&](const auto& other) { return other.id == marker.id; });
    if (same == 1) sightings[marker.id].push_back({image, marker.corners});
  }
}

Sightings find_markers(const Model& model,
                       const std::function<std::string(const std::string&)>& path_of,
                       const FindMarkers& find, Progress& progress, const std::stop_token& stop) {
  Sightings sightings;
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
      throw InputError(path, fmt::format("is {}x{}, but its camera in the model {}x{}", gray.cols,
                                         gray.rows, camera.width, camera.height));
    }
    add_sightings(find(gray), static_cast<int>(i), sightings);
    progress.advance();
  }
  progress.end();
  return sightings;
}

// Whether two of the cameras see the point under a large enough angle.
bool is_wide(const Model& model, const std::vector<Sighting>& seen, const Eigen::Vector3d& point) {
  const auto center = [&](const Sighting& one) {
    return model.images[static_cast<std::size_t>(one.image)].pose.center();
  };
  for (std::size_t a = 0; a < seen.size(); ++a)
    for (std::size_t b = a + 1; b < seen.size(); ++b)
      if (ray_angle(point, center(seen[a]), center(seen[b])) >= kMinAngle) return true;
  return false;
}

enum class Verdict { kSquare, kNarrow, kNoSquare };

// Triangulates a corner of a marker from all images that show it; empty where that fails.
std::optional<Eigen::Vector3d> corner_of(const Model& model, const std::vector<Sighting>& seen,
                                         std::size_t corner) {
  std::vector<ObservationRay> rays;
  for (const Sighting& one : seen) {
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
double reprojection_of(const Model& model, const Sighting& seen, const Square& corners) {
  const Image& image = model.images[static_cast<std::size_t>(seen.image)];
  const geometry::Camera& camera = model.cameras[static_cast<std::size_t>(image.camera)];
  double worst = 0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const auto pixel = camera.project(image.pose * corners[k]);
    if (!pixel) return HUGE_VAL;
    worst = std::max(worst, (Eigen::Vector2d(pixel->x, pixel->y) - seen.corners[k]).norm());
  }
  return worst;
}

// The mean side; 0 where the sides or the diagonals differ too much.
double side_of(const Square& corners) {
  std::array<double, 4> sides{};
  for (std::size_t k = 0; k < 4; ++k) sides[k] = (corners[(k + 1) % 4] - corners[k]).norm();
  const double mean = (sides[0] + sides[1] + sides[2] + sides[3]) / 4;
  const double first = (corners[2] - corners[0]).norm();
  const double second = (corners[3] - corners[1]).norm();
  const auto [least, most] = std::minmax_element(sides.begin(), sides.end());
  const bool is_square = *most - *least <= kMaxDifference * mean &&
                         std::abs(first - second) <= kMaxDifference * std::max(first, second);
  return is_square ? mean : 0;
}

// Measures the side of a marker, in units of the model. The worst images are removed from `seen`,
// but fewer than half.
Verdict measure(const Model& model, std::vector<Sighting>& seen, double& side) {
  const std::size_t all = seen.size();
  while (seen.size() >= 2) {
    Square corners;
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const auto point = corner_of(model, seen, k);
      if (!point) return Verdict::kNoSquare;
      corners[k] = *point;
    }
    if (!is_wide(model, seen, corners[0])) return Verdict::kNarrow;
    std::vector<double> errors;
    for (const Sighting& one : seen) errors.push_back(reprojection_of(model, one, corners));
    const auto worst = std::max_element(errors.begin(), errors.end());
    if (*worst <= kMaxReprojection) {
      side = side_of(corners);
      return side > 0 ? Verdict::kSquare : Verdict::kNoSquare;
    }
    if (2 * (seen.size() - 1) <= all) return Verdict::kNoSquare;
    seen.erase(seen.begin() + (worst - errors.begin()));
  }
  return Verdict::kNarrow;
}

}  // namespace

void KnownMarkers::check() const {
  TARSIER_REQUIRE(side > 0 && std::isfinite(side), "markers of {}: expected above 0", side);
  TARSIER_REQUIRE(find != nullptr, "nothing that finds markers");
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
  Sightings sightings = find_markers(model, path_of, known.find, progress, stop);
  MarkerScale result;
  std::vector<double> sides;
  std::vector<bool> shows(model.images.size(), false);
  for (auto& [id, seen] : sightings) {
    double side = 0;
    const Verdict verdict = measure(model, seen, side);
    if (verdict == Verdict::kNoSquare) {
      log_warning("marker {}: its corners in {} images make no square; it does not count", id,
                  seen.size());
      ++result.left_out;
    }
    if (verdict != Verdict::kSquare) continue;
    sides.push_back(side);
    for (const Sighting& one : seen) shows[static_cast<std::size_t>(one.image)] = true;
  }
  if (sides.empty()) {
    const std::string what =
        sightings.empty()
            ? "no marker is seen in the images of the model"
            : fmt::format(
                  "of the {} markers that are seen none is measured by two images from "
                  "different sides",
                  sightings.size());
    throw Error(ErrorKind::kInput, "scale by markers: " + what);
  }
  const double middle = upper_median(sides);
  result.scale = known.side / middle;
  result.markers = static_cast<int>(sides.size());
  result.images = static_cast<int>(std::count(shows.begin(), shows.end(), true));
  for (const double side : sides)
    result.spread = std::max(result.spread, std::abs(side / middle - 1));
  if (result.spread > kMaxSpread) {
    log_warning(
        "the sides of the {} markers differ by up to {:.0f} %: not all are of the same size",
        result.markers, 100 * result.spread);
  }
  return result;
}

}  // namespace tarsier::sfm
