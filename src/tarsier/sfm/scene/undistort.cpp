// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/undistort.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>
#include <vector>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr int kJpegQuality = 95;
using geometry::kMaxUndistortedSide;

std::size_t index_of(int index, std::size_t size, const std::string& what) {
  TARSIER_REQUIRE(index >= 0 && static_cast<std::size_t>(index) < size, "camera {} of '{}'", index,
                  what);
  return static_cast<std::size_t>(index);
}

}  // namespace

Model undistorted_model(const Model& model) {
  Model result = model;
  for (geometry::Camera& camera : result.cameras) camera = undistorted_camera(camera);
  for (Image& image : result.images) {
    const std::size_t c = index_of(image.camera, model.cameras.size(), image.name);
    const geometry::Camera& from = model.cameras[c];
    const geometry::Camera& to = result.cameras[c];
    if (!from.is_distorted()) continue;
    for (cv::Point2f& feature : image.features) {
      const auto point = from.normalized_of({feature.x, feature.y});
      if (!point) {
        throw Error(
            ErrorKind::kInput,
            fmt::format(
                "the feature ({}, {}) of '{}' is too far outside the image to be undistorted",
                feature.x, feature.y, printable(image.name)));
      }
      const cv::Point2d pixel = to.pixel_of(*point);
      feature = {static_cast<float>(pixel.x), static_cast<float>(pixel.y)};
    }
  }
  return result;
}

void export_undistorted(const std::string& folder, const Model& model,
                        const std::function<cv::Mat(const std::string& name)>& read_named_image,
                        Progress& progress, const std::stop_token& stop) {
  const fs::path images_folder = fs::path(folder) / "images";
  std::set<fs::path> files;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    const std::string file = (images_folder / image.name).string();
    if (!is_image_path(image.name)) {
      throw OutputError(
          printable(file),
          "this image file extension cannot be written: use .jpg, .png, .webp, .bmp, .ppm");
    }
    if (!files.insert(fs::path(image.name).lexically_normal()).second)
      throw OutputError(printable(file), "two images would be written to this file");
    const geometry::Camera& camera =
        model.cameras[index_of(image.camera, model.cameras.size(), image.name)];
    if (std::max(camera.width, camera.height) > kMaxUndistortedSide) {
      throw OutputError(printable(file),
                        fmt::format("{}x{} px is larger than the limit of {} px", camera.width,
                                    camera.height, kMaxUndistortedSide));
    }
  }
  const Model straight = undistorted_model(model);
  throw_if_stopped(stop);
  // Before the images, as it rejects names that lead out of the folder.
  write_colmap((fs::path(folder) / "sparse").string(), straight);
  make_folder(images_folder.string());
  progress.begin("undistort", static_cast<std::int64_t>(files.size()), "images");
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    throw_if_stopped(stop);
    const auto c = static_cast<std::size_t>(image.camera);
    const geometry::Camera& from = model.cameras[c];
    const cv::Mat pixels = read_named_image(image.name);
    if (pixels.cols != from.width || pixels.rows != from.height) {
      throw InputError(printable(image.name),
                       fmt::format("the image has {}x{} px, but its camera has {}x{} px",
                                   pixels.cols, pixels.rows, from.width, from.height));
    }
    const fs::path path = images_folder / image.name;
    make_folder(path.parent_path().string());
    write_image(path.string(), undistort_image(pixels, from, straight.cameras[c]), kJpegQuality);
    progress.advance();
  }
  progress.end();
}

}  // namespace tarsier::sfm
