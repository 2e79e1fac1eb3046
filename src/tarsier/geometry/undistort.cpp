// SPDX-License-Identifier: MIT
#include "tarsier/geometry/undistort.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <limits>

namespace tarsier::geometry {
namespace {

constexpr int kMaxBorderSamples = 1000;     // points on each side of an image
constexpr double kMaxFisheyeTangent = 1.8;  // tangent of the angle to which a fisheye is limited

cv::Point2d border_ray(const Camera& camera, double x, double y) {
  const auto point = camera.normalized_of({x, y});
  if (camera.lens == Lens::kFisheye) {
    const cv::Point2d ray = point.value_or(cv::Point2d(x - camera.cx, y - camera.cy) * 1e6);
    return {std::clamp(ray.x, -kMaxFisheyeTangent, kMaxFisheyeTangent),
            std::clamp(ray.y, -kMaxFisheyeTangent, kMaxFisheyeTangent)};
  }
  if (!point) {
    throw Error(ErrorKind::kInput,
                fmt::format("the distortion of a camera ({}x{} px, k1 {:.4g}) cannot be undone at "
                            "the border of its image",
                            camera.width, camera.height, camera.distortion[0]));
  }
  return *point;
}

}  // namespace

Camera undistorted_camera(const Camera& camera) {
  camera.check();
  if (!camera.is_distorted()) return camera;
  const double right_px = camera.width - 1;
  const double bottom_px = camera.height - 1;
  double left = -std::numeric_limits<double>::infinity();
  double top = left;
  double right = -left;
  double bottom = -left;
  const int columns = std::min(camera.width, kMaxBorderSamples);
  for (int k = 0; k < columns; ++k) {
    const double x = columns > 1 ? right_px * k / (columns - 1) : 0;
    top = std::max(top, border_ray(camera, x, 0).y);
    bottom = std::min(bottom, border_ray(camera, x, bottom_px).y);
  }
  const int rows = std::min(camera.height, kMaxBorderSamples);
  for (int k = 0; k < rows; ++k) {
    const double y = rows > 1 ? bottom_px * k / (rows - 1) : 0;
    left = std::max(left, border_ray(camera, 0, y).x);
    right = std::min(right, border_ray(camera, right_px, y).x);
  }
  if (!(right > left && bottom > top)) {
    throw Error(ErrorKind::kInput,
                fmt::format("nothing remains of an image of {}x{} px when its distortion (k1 "
                            "{:.4g}) is undone",
                            camera.width, camera.height, camera.distortion[0]));
  }
  Camera result = camera;
  result.lens = Lens::kPinhole;
  result.distortion = {};
  result.fx = right_px / (right - left);
  result.fy = bottom_px / (bottom - top);
  if (camera.lens == Lens::kFisheye) result.fx = result.fy = std::max(result.fx, result.fy);
  result.cx = 0.5 * (right_px - (left + right) * result.fx);
  result.cy = 0.5 * (bottom_px - (top + bottom) * result.fy);
  return result;
}

Undistorter::Undistorter(const Camera& from, const Camera& to) : from_(from.width, from.height) {
  from.check();
  to.check();
  TARSIER_REQUIRE(!to.is_distorted(), "k1 {}", to.distortion[0]);
  const int side = std::max({from.width, from.height, to.width, to.height});
  TARSIER_REQUIRE(side <= kMaxUndistortedSide, "{} px", side);
  is_same_ = !from.is_distorted() && from.width == to.width && from.height == to.height &&
             from.matrix() == to.matrix();
  if (is_same_) return;
  const cv::Size size(to.width, to.height);
  if (from.lens == Lens::kFisheye) {
    const cv::Vec4d k(from.distortion.data());
    cv::fisheye::initUndistortRectifyMap(from.matrix(), k, cv::noArray(), to.matrix(), size,
                                         CV_16SC2, map_, fractions_);
  } else {
    cv::initUndistortRectifyMap(from.matrix(), from.distortion, cv::noArray(), to.matrix(), size,
                                CV_16SC2, map_, fractions_);
  }
}

cv::Mat Undistorter::operator()(const cv::Mat& image) const {
  TARSIER_REQUIRE(image.dims == 2 && image.size() == from_,
                  "an image of {}x{} px of a camera of {}x{} px", image.cols, image.rows,
                  from_.width, from_.height);
  if (is_same_) return image.clone();
  cv::Mat result;
  cv::remap(image, result, map_, fractions_, cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  return result;
}

cv::Mat undistort_image(const cv::Mat& image, const Camera& from, const Camera& to) {
  return Undistorter(from, to)(image);
}

}  // namespace tarsier::geometry
