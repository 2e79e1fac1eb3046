// SPDX-License-Identifier: MIT
#include "framing.h"

#include "tarsier/core/statistics.h"
#include "tarsier/sfm/scene/sensor_image.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

constexpr double kFramedShare = 0.95;  // share of the points
constexpr double kSubjectShare = 0.8;  // share of the points that count as the subject
// max factor of the subject's size, e.g. for hills behind a statue
constexpr double kMaxSubjectFactor = 1.6;
constexpr double kMaxCameraFactor = 1.35;  // max factor of the points' size
constexpr double kMarginFactor = 1.08;

bool finite(const geometry::Rigid3& pose) {
  return pose.rotation.allFinite() && pose.translation.allFinite();
}

Eigen::Vector3d median_of(const std::vector<Eigen::Vector3d>& all) {
  Eigen::Vector3d result = Eigen::Vector3d::Zero();
  std::vector<double> values(all.size());
  for (int k = 0; k < 3; ++k) {
    std::transform(all.begin(), all.end(), values.begin(), [k](const auto& x) { return x[k]; });
    result[k] = nearest_quantile(values, 0.5);
  }
  return result;
}

struct Extent {
  double across = 0;
  double upright = 0;
};

Extent extent_of(const std::vector<Eigen::Vector3d>& all, const Framing& framing, double share) {
  std::vector<double> across;
  std::vector<double> upright;
  across.reserve(all.size());
  upright.reserve(all.size());
  for (const Eigen::Vector3d& x : all) {
    const Eigen::Vector3d framed = framing.framed(x);
    across.push_back(std::hypot(framed[0], framed[2]));
    upright.push_back(framed[1]);
  }
  Extent result;
  result.across = nearest_quantile(across, share);
  const double low = nearest_quantile(upright, 1 - share);
  const double high = nearest_quantile(upright, share);
  result.upright = std::max(std::abs(low), std::abs(high));
  return result;
}

// Images are roughly in the order of capture. The median step determines how large cameras can be
// drawn without overlapping.
double camera_size_of(const std::vector<Eigen::Vector3d>& centers, double scale) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < centers.size(); ++i)
    steps.push_back((centers[i] - centers[i - 1]).norm());
  const double step = steps.empty() ? scale : nearest_quantile(steps, 0.5);
  return std::clamp(0.4 * step, 0.03 * scale, 0.1 * scale);
}

}  // namespace

Framing frame_model(const Model& model, bool with_cameras) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(model.points.size());
  for (const Point& point : model.points)
    if (point.position.allFinite()) points.push_back(point.position);
  std::vector<Eigen::Vector3d> centers;
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  Eigen::Vector3d forward = Eigen::Vector3d::Zero();
  Eigen::Vector3d first_forward = Eigen::Vector3d::Zero();
  for (const Image& image : model.images) {
    if (!image.registered || !finite(image.pose)) continue;
    const Eigen::Matrix3d axes = image.pose.rotation.transpose();
    if (centers.empty()) first_forward = axes.col(2);
    centers.push_back(image.pose.center());
    down += axes * down_direction(image.turns);
    forward += axes.col(2);
  }

  Framing framing;
  const auto count = static_cast<double>(centers.size());
  Eigen::Vector3d up(0, -1, 0);
  if (down.norm() > 1e-3 * count) up = -down.normalized();
  // Cameras all around cancel out: then the first one defines the front.
  Eigen::Vector3d front = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& candidate : std::initializer_list<Eigen::Vector3d>{
           forward / std::max(count, 1.0), first_forward, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}}) {
    front = candidate - up * candidate.dot(up);
    if (front.norm() > 0.2) break;
  }
  front.normalize();
  framing.base << front.cross(up).transpose(), up.transpose(), -front.transpose();

  framing.center = median_of(points.empty() ? centers : points);
  Extent extent = extent_of(points, framing, kFramedShare);
  const Extent subject = extent_of(points, framing, kSubjectShare);
  if (const double subject_size = std::max(subject.across, subject.upright); subject_size > 0) {
    extent.across = std::min(extent.across, kMaxSubjectFactor * subject_size);
    extent.upright = std::min(extent.upright, kMaxSubjectFactor * subject_size);
  }
  const Extent cameras = extent_of(centers, framing, 0.8);
  double size = std::max(extent.across, extent.upright);
  if (!(size > 0)) {
    size = std::max(cameras.across, cameras.upright);
    extent.across = size > 0 ? size : 1;
  } else if (with_cameras) {
    extent.across = std::max(extent.across, std::min(cameras.across, kMaxCameraFactor * size));
    extent.upright = std::max(extent.upright, std::min(cameras.upright, kMaxCameraFactor * size));
  }
  framing.radius = std::max(extent.across, 1e-3 * std::max(extent.upright, size));
  framing.half_height = extent.upright;
  framing.cloud = size > 0 ? size : 1;
  framing.camera_size = camera_size_of(centers, framing.cloud);
  return framing;
}

std::vector<Pyramid> camera_pyramids(const Model& model, const Framing& framing) {
  std::vector<Pyramid> result;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const Image& image = model.images[i];
    if (!image.registered || !finite(image.pose)) continue;
    // Tangents of half the angles of view; typical values for an unknown camera.
    double across = 0.6;
    double upright = 0.45;
    if (image.camera >= 0 && static_cast<std::size_t>(image.camera) < model.cameras.size()) {
      const geometry::Camera& camera = model.cameras[static_cast<std::size_t>(image.camera)];
      if (camera.fx > 0 && camera.fy > 0 && camera.width > 0 && camera.height > 0) {
        across = std::min(0.5 * camera.width / camera.fx, 2.0);
        upright = std::min(0.5 * camera.height / camera.fy, 2.0);
      }
    }
    const geometry::Rigid3 world = image.pose.inverse();
    const double depth = framing.camera_size;
    Pyramid pyramid;
    pyramid.image = static_cast<int>(i);
    pyramid.vertices = {world.translation, world * (depth * Eigen::Vector3d(-across, -upright, 1)),
                        world * (depth * Eigen::Vector3d(across, -upright, 1)),
                        world * (depth * Eigen::Vector3d(across, upright, 1)),
                        world * (depth * Eigen::Vector3d(-across, upright, 1))};
    result.push_back(pyramid);
  }
  return result;
}

double fitting_distance(double radius, double half_height, double pitch, double tan_across,
                        double tan_upright) {
  const double tilt = std::abs(std::sin(pitch));
  const double level = std::cos(pitch);
  // Horizontally it must fit at any rotation: a circle between the two edges of the view.
  const double across = radius * std::hypot(1.0, tan_across) / tan_across;
  const double upright = (half_height * level + radius * tilt) / tan_upright + 0.5 * radius * level;
  return kMarginFactor * std::max(across, upright);
}

}  // namespace tarsier::sfm
