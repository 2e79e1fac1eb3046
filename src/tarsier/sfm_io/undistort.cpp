// SPDX-License-Identifier: MIT
#include "tarsier/sfm_io/undistort.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/atomic_file.h"
#include "tarsier/io/image_file.h"
#include "tarsier/sfm_io/colmap.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <vector>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr int kJpegQuality = 95;
constexpr int kMostPlaces = 1000;  // on each side of a picture
constexpr int kMostSide = 32'766;  // px, of cv::remap

std::size_t index_of(int index, std::size_t size, const std::string& what) {
  TARSIER_REQUIRE(index >= 0 && static_cast<std::size_t>(index) < size, "camera {} of '{}'", index,
                  what);
  return static_cast<std::size_t>(index);
}

}  // namespace

geometry::Camera undistorted_camera(const geometry::Camera& camera) {
  camera.check();
  if (!camera.is_distorted()) return camera;
  const double right_px = camera.width - 1;
  const double bottom_px = camera.height - 1;
  const auto normalized = [&](double x, double y) {
    const auto point = camera.normalized_of({x, y});
    if (!point) {
      throw Error(
          ExitStatus::kBadInput,
          fmt::format("the distortion of a camera ({}x{} px, k1 {:.4g}) cannot be undone at "
                      "the border of its picture",
                      camera.width, camera.height, camera.distortion[0]));
    }
    return *point;
  };
  double left = -std::numeric_limits<double>::infinity();
  double top = left;
  double right = -left;
  double bottom = -left;
  const int columns = std::min(camera.width, kMostPlaces);
  for (int k = 0; k < columns; ++k) {
    const double x = columns > 1 ? right_px * k / (columns - 1) : 0;
    top = std::max(top, normalized(x, 0).y);
    bottom = std::min(bottom, normalized(x, bottom_px).y);
  }
  const int rows = std::min(camera.height, kMostPlaces);
  for (int k = 0; k < rows; ++k) {
    const double y = rows > 1 ? bottom_px * k / (rows - 1) : 0;
    left = std::max(left, normalized(0, y).x);
    right = std::min(right, normalized(right_px, y).x);
  }
  if (!(right > left && bottom > top)) {
    throw Error(ExitStatus::kBadInput,
                fmt::format("nothing remains of a picture of {}x{} px when its distortion (k1 "
                            "{:.4g}) is undone",
                            camera.width, camera.height, camera.distortion[0]));
  }
  geometry::Camera result = camera;
  result.distortion = {};
  result.fx = right_px / (right - left);
  result.fy = bottom_px / (bottom - top);
  result.cx = -left * result.fx;
  result.cy = -top * result.fy;
  return result;
}

Model undistorted_model(const Model& model) {
  Model result = model;
  for (geometry::Camera& camera : result.cameras) camera = undistorted_camera(camera);
  for (Photograph& image : result.images) {
    const std::size_t c = index_of(image.camera, model.cameras.size(), image.name);
    const geometry::Camera& from = model.cameras[c];
    const geometry::Camera& to = result.cameras[c];
    if (!from.is_distorted()) continue;
    for (cv::Point2f& feature : image.features) {
      const auto point = from.normalized_of({feature.x, feature.y});
      if (!point) {
        throw Error(ExitStatus::kBadInput,
                    fmt::format("the feature ({}, {}) of '{}' is too far outside to be undistorted",
                                feature.x, feature.y, printable(image.name)));
      }
      const cv::Point2d pixel = to.pixel_of(*point);
      feature = {static_cast<float>(pixel.x), static_cast<float>(pixel.y)};
    }
  }
  return result;
}

cv::Mat undistort_image(const cv::Mat& image, const geometry::Camera& from,
                        const geometry::Camera& to) {
  from.check();
  to.check();
  TARSIER_REQUIRE(image.dims == 2 && image.cols == from.width && image.rows == from.height,
                  "a picture of {}x{} px of a camera of {}x{} px", image.cols, image.rows,
                  from.width, from.height);
  TARSIER_REQUIRE(!to.is_distorted(), "k1 {}", to.distortion[0]);
  const int side = std::max({from.width, from.height, to.width, to.height});
  TARSIER_REQUIRE(side <= kMostSide, "{} px", side);
  const bool is_same = !from.is_distorted() && from.width == to.width && from.height == to.height &&
                       from.matrix() == to.matrix();
  if (is_same) return image.clone();
  cv::Mat map;
  cv::Mat fractions;
  cv::initUndistortRectifyMap(from.matrix(), from.distortion, cv::noArray(), to.matrix(),
                              {to.width, to.height}, CV_16SC2, map, fractions);
  cv::Mat result;
  cv::remap(image, result, map, fractions, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  return result;
}

void export_undistorted(const std::string& folder, const Model& model,
                        const std::function<cv::Mat(const std::string& name)>& read_photograph,
                        Progress& progress, const std::stop_token& stop) {
  const fs::path pictures = fs::path(folder) / "images";
  std::set<fs::path> files;
  for (const Photograph& image : model.images) {
    if (!image.registered) continue;
    const std::string file = (pictures / image.name).string();
    if (!is_image_path(image.name)) {
      throw OutputError(
          printable(file),
          "unknown ending for a picture: .jpg, .png, .webp, .bmp and .ppm are written");
    }
    if (!files.insert(fs::path(image.name).lexically_normal()).second)
      throw OutputError(printable(file), "would be written twice");
    const geometry::Camera& camera =
        model.cameras[index_of(image.camera, model.cameras.size(), image.name)];
    if (std::max(camera.width, camera.height) > kMostSide) {
      throw OutputError(printable(file), fmt::format("{}x{} px is larger than the limit of {} px",
                                                     camera.width, camera.height, kMostSide));
    }
  }
  const Model straight = undistorted_model(model);
  throw_if_stopped(stop);
  // Before the pictures: this refuses names that lead out of the folder.
  write_colmap((fs::path(folder) / "sparse").string(), straight);
  make_folder(pictures.string());
  progress.begin("undistort", static_cast<std::int64_t>(files.size()), "photographs");
  for (const Photograph& image : model.images) {
    if (!image.registered) continue;
    throw_if_stopped(stop);
    const auto c = static_cast<std::size_t>(image.camera);
    const geometry::Camera& from = model.cameras[c];
    const cv::Mat picture = read_photograph(image.name);
    if (picture.cols != from.width || picture.rows != from.height) {
      throw InputError(printable(image.name),
                       fmt::format("has {}x{} px, its camera {}x{}", picture.cols, picture.rows,
                                   from.width, from.height));
    }
    const fs::path path = pictures / image.name;
    make_folder(path.parent_path().string());
    write_image(path.string(), undistort_image(picture, from, straight.cameras[c]), kJpegQuality);
    progress.advance();
  }
  progress.end();
}

}  // namespace tarsier::sfm
