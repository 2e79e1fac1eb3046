// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/workspace.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/geometry/scaled_camera.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/stored_image.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

bool is_file(const std::string& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

void write_map(const std::string& path, const cv::Mat& map) {
  make_folder(fs::path(path).parent_path().string());
  write_colmap_map(path, map);
}

// For each pixel, the direction to the camera.
cv::Mat facing_normals(const geometry::Camera& camera, cv::Size size) {
  cv::Mat3f normals(size);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const cv::Vec3d ray((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1);
      normals(y, x) = cv::Vec3f(ray * (-1 / cv::norm(ray)));
    }
  }
  return normals;
}

void keep_known(DepthMap& map) {
  for (int y = 0; y < map.depth.rows; ++y) {
    auto* depth = map.depth.ptr<float>(y);
    auto* normal = map.normal.ptr<cv::Vec3f>(y);
    auto* confidence = map.confidence.ptr<float>(y);
    for (int x = 0; x < map.depth.cols; ++x) {
      const double length = cv::norm(normal[x]);
      const bool is_known = std::isfinite(depth[x]) && depth[x] > 0 && std::isfinite(length) &&
                            length > 0 && std::isfinite(confidence[x]);
      if (is_known) {
        normal[x] *= static_cast<float>(1 / length);
        confidence[x] = std::clamp(confidence[x], 0.F, 1.F);
      } else {
        depth[x] = 0;
        normal[x] = {0, 0, 0};
        confidence[x] = 0;
      }
    }
  }
}

}  // namespace

void check_coordinates(const Model& model) {
  int images = 0;
  int beyond = 0;
  const Image* example = nullptr;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    const Eigen::Vector3d center = image.pose.center();
    std::vector<double> distances;
    for (const int point : image.points)
      if (point >= 0 && static_cast<std::size_t>(point) < model.points.size())
        distances.push_back(
            (model.points[static_cast<std::size_t>(point)].position - center).norm());
    if (distances.empty()) continue;
    const auto median = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
    std::nth_element(distances.begin(), median, distances.end());
    ++images;
    if (!is_beyond_float(center, *median)) continue;
    ++beyond;
    if (example == nullptr) example = &image;
  }
  if (2 * beyond <= images) return;
  const Eigen::Vector3d center = example->pose.center();
  throw Error(ErrorKind::kInput,
              fmt::format("the coordinates of the model are too large for depth maps and surfaces "
                          "('{}' is at {:.0f}, {:.0f}, {:.0f}): subtract one offset from all known "
                          "positions, and align the model with these",
                          printable(example->name), center[0], center[1], center[2]));
}

std::string_view name_of(MapKind kind) {
  return kind == MapKind::kPhotometric ? "photometric" : "geometric";
}

Workspace Workspace::open(const std::string& folder) {
  const fs::path path(folder);
  std::error_code ignored;
  if (!fs::is_directory(path, ignored))
    throw InputError(printable(folder), "is not a folder: make it with 'tarsier sfm dense'");
  if (!fs::is_directory(path / "sparse", ignored)) {
    throw InputError(printable(folder),
                     "contains no folder sparse/: expected a folder made by 'tarsier sfm dense', "
                     "or by COLMAP's image_undistorter with a model in text format");
  }
  Model model = read_colmap((path / "sparse").string());
  for (const Image& image : model.images) {
    if (model.cameras[static_cast<std::size_t>(image.camera)].is_distorted()) {
      throw InputError(
          (path / "sparse" / "cameras.txt").string(),
          fmt::format("the camera of '{}' has lens distortion, but dense reconstruction needs "
                      "undistorted images: run 'tarsier sfm dense'",
                      printable(image.name)));
    }
  }
  Workspace result;
  result.folder_ = folder;
  result.model_ = std::make_shared<const Model>(std::move(model));
  return result;
}

int Workspace::count() const { return static_cast<int>(model_->images.size()); }

const Image& Workspace::image(int index) const {
  TARSIER_REQUIRE(index >= 0 && index < count(), "image {} of {}", index, count());
  return model_->images[static_cast<std::size_t>(index)];
}

const std::string& Workspace::name(int index) const { return image(index).name; }

const geometry::Camera& Workspace::camera(int index) const {
  return model_->cameras[static_cast<std::size_t>(image(index).camera)];
}

const geometry::Rigid3& Workspace::pose(int index) const { return image(index).pose; }

std::string Workspace::path_of_image(int index) const {
  return (fs::path(folder_) / "images" / name(index)).string();
}

std::string Workspace::path_of_map(int index, std::string_view what, MapKind kind) const {
  const std::string ending = what == "confidence" && kind == MapKind::kGeometric
                                 ? ".bin"
                                 : fmt::format(".{}.bin", name_of(kind));
  return (fs::path(folder_) / "stereo" / what / (name(index) + ending)).string();
}

cv::Mat Workspace::read_image(int index) const {
  const std::string path = path_of_image(index);
  cv::Mat pixels = read_stored_image(path);  // other programs copy EXIF to undistorted images
  const geometry::Camera& of = camera(index);
  if (pixels.cols != of.width || pixels.rows != of.height) {
    throw InputError(path, fmt::format("has {}x{} px, but its camera has {}x{} px", pixels.cols,
                                       pixels.rows, of.width, of.height));
  }
  return pixels;
}

bool Workspace::has_depth_map(int index, MapKind kind) const {
  return is_file(path_of_map(index, "depth_maps", kind));
}

DepthMap Workspace::read_depth_map(int index, MapKind kind) const {
  const std::string path = path_of_map(index, "depth_maps", kind);
  if (!is_file(path)) {
    throw InputError(
        path, fmt::format(
                  "the depth map of '{}' is missing: run 'tarsier sfm dense' again to complete it",
                  printable(name(index))));
  }
  DepthMap map;
  map.depth = read_colmap_map(path, 1);
  const auto scaled = geometry::scaled_camera(camera(index), map.depth.size());
  if (!scaled) {
    throw InputError(path, fmt::format("has {}x{} px, but its camera has {}x{} px", map.depth.cols,
                                       map.depth.rows, camera(index).width, camera(index).height));
  }
  const auto optional_map = [&](std::string_view what, int channels) {
    const std::string file = path_of_map(index, what, kind);
    if (!is_file(file)) return cv::Mat();
    cv::Mat numbers = read_colmap_map(file, channels);
    if (numbers.size() != map.depth.size()) {
      throw InputError(file,
                       fmt::format("has {}x{} px, but the depth map has {}x{} px", numbers.cols,
                                   numbers.rows, map.depth.cols, map.depth.rows));
    }
    return numbers;
  };
  map.normal = optional_map("normal_maps", 3);
  if (map.normal.empty()) map.normal = facing_normals(*scaled, map.depth.size());
  map.confidence = optional_map("confidence", 1);
  if (map.confidence.empty()) map.confidence = cv::Mat(map.depth.size(), CV_32FC1, cv::Scalar(1));
  keep_known(map);
  return map;
}

void Workspace::write_depth_map(int index, const DepthMap& map, MapKind kind) const {
  map.check();
  (void)camera_of_map(camera(index), map.depth.size());
  if (!map.normal.empty()) write_map(path_of_map(index, "normal_maps", kind), map.normal);
  if (!map.confidence.empty()) write_map(path_of_map(index, "confidence", kind), map.confidence);
  write_map(path_of_map(index, "depth_maps", kind), map.depth);
}

}  // namespace tarsier::sfm
