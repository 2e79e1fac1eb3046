// SPDX-License-Identifier: MIT
#include "verbs/sfm/synth_truth.h"

#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/surface/surface_files.h"

#include <Eigen/Geometry>
#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

constexpr double kCameraDistance = 10;  // units, distance of the cameras from a rendered scene
constexpr int kPointsAcross = 40;       // number of points across the width of an image
// share of the depth, within which depths count as the same surface
constexpr double kMaxDepthDifference = 1e-3;
// share of the depth, max difference between neighbours without an edge
constexpr double kMaxDepthStep = 0.05;

cv::Mat1f depth_of(const synth::SfmScene& scene, int index, const std::stop_token& stop) {
  const geometry::Camera camera = scene.camera();
  cv::Mat1f depth(camera.height, camera.width, 0.F);
  cv::parallel_for_(cv::Range(0, depth.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end && !stop.stop_requested(); ++y)
      for (int x = 0; x < depth.cols; ++x)
        depth(y, x) = static_cast<float>(scene.depth(index, cv::Point2d(x, y)).value_or(0));
  });
  throw_if_stopped(stop);
  return depth;
}

// Normals from neighbours on the same surface. Without such neighbours, the normal points to the
// camera.
cv::Mat3f normals_of(const geometry::Camera& camera, const cv::Mat1f& depth) {
  cv::Mat3f normals(depth.size(), cv::Vec3f(0, 0, 0));
  const auto point = [&](int x, int y) {
    const double z = depth(y, x);
    return Eigen::Vector3d((x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z);
  };
  const auto difference = [&](int x, int y, int dx, int dy) -> Eigen::Vector3d {
    for (const int side : {1, -1}) {
      const int u = x + side * dx;
      const int v = y + side * dy;
      if (u < 0 || v < 0 || u >= depth.cols || v >= depth.rows || !(depth(v, u) > 0)) continue;
      if (std::abs(depth(v, u) / depth(y, x) - 1) < kMaxDepthStep)
        return side * (point(u, v) - point(x, y));
    }
    return Eigen::Vector3d::Zero();
  };
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      if (!(depth(y, x) > 0)) continue;
      Eigen::Vector3d normal = difference(x, y, 1, 0).cross(difference(x, y, 0, 1));
      if (!(normal.norm() > 0)) normal = -point(x, y);
      if (normal.dot(point(x, y)) > 0) normal = -normal;
      normal.normalize();
      normals(y, x) = {static_cast<float>(normal[0]), static_cast<float>(normal[1]),
                       static_cast<float>(normal[2])};
    }
  }
  return normals;
}

sfm::Model true_model(const synth::SfmScene& scene, const std::stop_token& stop) {
  sfm::Model model;
  model.cameras.push_back(scene.camera());
  for (int i = 0; i < scene.count(); ++i) {
    sfm::Image image;
    image.name = fmt::format("{:04}.jpg", i);
    image.registered = true;
    image.pose = scene.pose(i);
    model.images.push_back(image);
  }
  const geometry::Camera& camera = model.cameras[0];
  const double step = static_cast<double>(camera.width) / kPointsAcross;
  Rng rng(1);
  for (int i = 0; i < scene.count(); ++i) {
    throw_if_stopped(stop);
    for (double v = step / 2; v < camera.height; v += step) {
      for (double u = step / 2; u < camera.width; u += step) {
        const double right = rng.uniform(-0.4, 0.4) * step;
        const double down = rng.uniform(-0.4, 0.4) * step;
        const cv::Point2d pixel(u + right, v + down);
        const auto depth = scene.depth(i, pixel);
        if (!depth) continue;
        sfm::Point point;
        point.color = {128, 128, 128};
        point.position = scene.pose(i).inverse() *
                         Eigen::Vector3d((pixel.x - camera.cx) / camera.fx * *depth,
                                         (pixel.y - camera.cy) / camera.fy * *depth, *depth);
        for (int j = 0; j < scene.count(); ++j) {
          const Eigen::Vector3d in_camera = scene.pose(j) * point.position;
          const auto projection = camera.project(in_camera);
          if (!projection ||
              !(projection->x > 0 && projection->y > 0 && projection->x < camera.width - 1 &&
                projection->y < camera.height - 1))
            continue;
          const auto visible = scene.depth(j, *projection);
          if (!visible || !(std::abs(*visible / in_camera.z() - 1) < kMaxDepthDifference)) continue;
          sfm::Image& image = model.images[static_cast<std::size_t>(j)];
          point.track.push_back({j, static_cast<int>(image.features.size())});
          image.features.emplace_back(static_cast<float>(projection->x),
                                      static_cast<float>(projection->y));
          image.points.push_back(static_cast<int>(model.points.size()));
        }
        if (point.track.size() >= 2) {
          model.points.push_back(point);
        } else if (point.track.size() == 1) {
          model.images[static_cast<std::size_t>(point.track[0].image)].points.back() = -1;
        }
      }
    }
  }
  return model;
}

// Writes the exact surface, sampled at points about two pixels apart.
void write_mesh(const std::string& folder, const synth::SfmScene& scene,
                const std::stop_token& stop) {
  const double pixel = kCameraDistance / scene.camera().fx;
  synth::SceneSurface surface = scene.surface(std::clamp(2 * pixel, 0.02, 0.2), stop);
  sfm::TexturedSurface mesh;
  mesh.mesh.vertices = std::move(surface.vertices);
  mesh.mesh.faces = std::move(surface.triangles);
  sfm::write_surface((std::filesystem::path(folder) / "mesh.ply").string(), mesh);
}

}  // namespace

void write_depth_truth(const std::string& folder, const synth::SfmScene& scene,
                       const Context& context) {
  sfm::write_colmap((std::filesystem::path(folder) / "sparse").string(),
                    true_model(scene, context.stop));
  const sfm::Workspace workspace = sfm::Workspace::open(folder);
  context.progress->begin("depth", workspace.count(), "images");
  for (int i = 0; i < workspace.count(); ++i) {
    sfm::DepthMap map;
    map.depth = depth_of(scene, i, context.stop);
    map.normal = normals_of(workspace.camera(i), map.depth);
    workspace.write_depth_map(i, map);
    context.progress->advance();
  }
  context.progress->end();
  write_mesh(folder, scene, context.stop);
}

}  // namespace tarsier::cli
