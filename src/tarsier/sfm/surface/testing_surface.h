// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/scene/colmap.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

// Rendered dense workspaces with exact depth, for tests of surfaces.
namespace tarsier::sfm {

struct SurfaceHit {
  double t = 0;  // along the ray
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
};
// The first intersection of a ray with a surface.
using Caster = std::function<std::optional<SurfaceHit>(const Eigen::Vector3d& origin,
                                                       const Eigen::Vector3d& direction)>;

inline Caster sphere_caster(const Eigen::Vector3d& center, double radius) {
  return [=](const Eigen::Vector3d& origin,
             const Eigen::Vector3d& direction) -> std::optional<SurfaceHit> {
    const Eigen::Vector3d to = origin - center;
    const double b = to.dot(direction) / direction.squaredNorm();
    const double c = (to.squaredNorm() - radius * radius) / direction.squaredNorm();
    if (b * b < c) return std::nullopt;
    const double t = -b - std::sqrt(b * b - c);
    if (t <= 0) return std::nullopt;
    return SurfaceHit{t, (origin + t * direction - center) / radius};
  };
}

// A box centred at the origin.
inline Caster box_caster(const Eigen::Vector3d& half) {
  return [=](const Eigen::Vector3d& origin,
             const Eigen::Vector3d& direction) -> std::optional<SurfaceHit> {
    double enter = -1e300;
    double leave = 1e300;
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    for (int k = 0; k < 3; ++k) {
      if (std::abs(direction[k]) < 1e-12) {
        if (std::abs(origin[k]) > half[k]) return std::nullopt;
        continue;
      }
      const double side = direction[k] > 0 ? 1 : -1;
      const double t0 = (-side * half[k] - origin[k]) / direction[k];
      leave = std::min(leave, (side * half[k] - origin[k]) / direction[k]);
      if (t0 > enter) {
        enter = t0;
        normal = Eigen::Vector3d::Zero();
        normal[k] = -side;
      }
    }
    if (!(enter > 0 && enter < leave)) return std::nullopt;
    return SurfaceHit{enter, normal};
  };
}

// A camera at `center`, directed at the origin.
inline geometry::Rigid3 looking_at_origin(const Eigen::Vector3d& center) {
  const Eigen::Vector3d ahead = -center.normalized();
  const Eigen::Vector3d up =
      std::abs(ahead[2]) < 0.95 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
  const Eigen::Vector3d right = ahead.cross(up).normalized();
  geometry::Rigid3 pose;
  pose.rotation.row(0) = right;
  pose.rotation.row(1) = ahead.cross(right);
  pose.rotation.row(2) = ahead;
  pose.translation = -(pose.rotation * center);
  return pose;
}

// `count` cameras evenly around the origin (a Fibonacci spiral).
inline std::vector<geometry::Rigid3> cameras_all_around(int count, double distance) {
  std::vector<geometry::Rigid3> poses;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count;
    const double angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const double across = std::sqrt(1 - z * z);
    poses.push_back(looking_at_origin(
        distance * Eigen::Vector3d(across * std::cos(angle), across * std::sin(angle), z)));
  }
  return poses;
}

// Smooth colours as a function of the position, BGR.
inline cv::Vec3b test_color(const Eigen::Vector3d& x) {
  const auto wave = [](double phase) {
    return cv::saturate_cast<std::uint8_t>(128 + 90 * std::sin(phase));
  };
  return {wave(2.1 * x[0] + 0.3), wave(1.7 * x[1] + 1.1), wave(1.9 * x[2] - 0.4)};
}

struct RenderedView {
  DepthMap map;
  cv::Mat image;  // CV_8UC3
};

inline RenderedView render_view(const Caster& cast, const geometry::Camera& camera,
                                const geometry::Rigid3& pose) {
  RenderedView view;
  const cv::Size size(camera.width, camera.height);
  view.map.depth = cv::Mat(size, CV_32FC1, cv::Scalar::all(0));
  view.map.normal = cv::Mat(size, CV_32FC3, cv::Scalar::all(0));
  view.map.confidence = cv::Mat(size, CV_32FC1, cv::Scalar::all(1));
  view.image = cv::Mat(size, CV_8UC3, cv::Scalar::all(0));
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const Eigen::Vector3d ray((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1);
      const Eigen::Vector3d direction = pose.rotation.transpose() * ray;
      const auto hit = cast(pose.center(), direction);
      if (!hit) continue;
      view.map.depth.at<float>(y, x) = static_cast<float>(hit->t);
      const Eigen::Vector3d normal = pose.rotation * hit->normal;
      view.map.normal.at<cv::Vec3f>(y, x) = {static_cast<float>(normal[0]),
                                             static_cast<float>(normal[1]),
                                             static_cast<float>(normal[2])};
      view.image.at<cv::Vec3b>(y, x) = test_color(pose.center() + hit->t * direction);
    }
  }
  return view;
}

inline geometry::Camera test_camera(int width = 160, int height = 120, double focal = 150) {
  geometry::Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = focal;
  camera.cx = 0.5 * (width - 1);
  camera.cy = 0.5 * (height - 1);
  return camera;
}

// Writes a dense workspace. `change` may modify a view before it is written.
inline void write_workspace(const std::string& folder, const Caster& cast,
                            const geometry::Camera& camera,
                            const std::vector<geometry::Rigid3>& poses,
                            const std::function<void(int, RenderedView&)>& change = {}) {
  Model model;
  model.cameras = {camera};
  for (std::size_t i = 0; i < poses.size(); ++i) {
    Image image;
    image.name = fmt::format("{:03}.png", i);
    image.registered = true;
    image.pose = poses[i];
    model.images.push_back(image);
  }
  make_folder(folder + "/sparse");
  make_folder(folder + "/images");
  write_colmap(folder + "/sparse", model);
  const Workspace workspace = Workspace::open(folder);
  for (int i = 0; i < workspace.count(); ++i) {
    RenderedView view = render_view(cast, camera, workspace.pose(i));
    if (change) change(i, view);
    write_image(workspace.path_of_image(i), view.image);
    workspace.write_depth_map(i, view.map);
  }
}

}  // namespace tarsier::sfm
