// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/plane_field.h"

#include "tarsier/core/require.h"

#include <Eigen/Core>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

Eigen::Matrix3d matrix_of(const geometry::Camera& camera) {
  Eigen::Matrix3d matrix;
  matrix << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  return matrix;
}

void copy(const Eigen::Matrix3d& from, std::array<float, 9>& to) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      to[static_cast<std::size_t>(3 * r + c)] = static_cast<float>(from(r, c));
}

void copy(const Eigen::Vector3d& from, std::array<float, 3>& to) {
  for (int r = 0; r < 3; ++r) to[static_cast<std::size_t>(r)] = static_cast<float>(from[r]);
}

}  // namespace

cv::Vec3f normal_of(const geometry::Camera& camera, int x, int y, const Plane& plane) {
  // The plane n X = d, divided by d, is (a, b, c) X = 1. The normal is opposite to (a, b, c).
  const double a = plane.slope_x * camera.fx;
  const double b = plane.slope_y * camera.fy;
  const double c =
      plane.inverse_depth - plane.slope_x * (x - camera.cx) - plane.slope_y * (y - camera.cy);
  const double length = std::sqrt(a * a + b * b + c * c);
  if (!(length > 0)) return {0, 0, -1};
  return {static_cast<float>(-a / length), static_cast<float>(-b / length),
          static_cast<float>(-c / length)};
}

Plane plane_of(const geometry::Camera& camera, int x, int y, float inverse_depth,
               const cv::Vec3f& normal) {
  const double along =
      normal[0] * (x - camera.cx) / camera.fx + normal[1] * (y - camera.cy) / camera.fy + normal[2];
  if (!(std::abs(along) > 1e-6)) return {inverse_depth, 0, 0};
  const double scale = inverse_depth / along;
  return {inverse_depth, static_cast<float>(normal[0] * scale / camera.fx),
          static_cast<float>(normal[1] * scale / camera.fy)};
}

std::vector<std::uint32_t> gray_words(const cv::Mat1b& gray) {
  const int width = gray.cols;
  std::vector<std::uint32_t> all(gray.total());
  for (int y = 0; y < gray.rows; ++y) {
    const std::uint8_t* row = gray.ptr(y);
    const std::uint8_t* next = gray.ptr(std::min(y + 1, gray.rows - 1));
    std::uint32_t* words =
        all.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
    for (int x = 0; x < width; ++x) {
      const int right = std::min(x + 1, width - 1);
      words[x] = static_cast<std::uint32_t>(row[x]) | static_cast<std::uint32_t>(row[right]) << 8 |
                 static_cast<std::uint32_t>(next[x]) << 16 |
                 static_cast<std::uint32_t>(next[right]) << 24;
    }
  }
  return all;
}

SourceLevel make_source(const cv::Mat1b& gray, const geometry::Camera& camera,
                        const geometry::Rigid3& source_from_reference,
                        const geometry::Camera& reference) {
  TARSIER_REQUIRE(
      gray.cols == camera.width && gray.rows == camera.height && gray.cols >= 2 && gray.rows >= 2,
      "an image of {}x{} px with a camera of {}x{} px", gray.cols, gray.rows, camera.width,
      camera.height);
  SourceLevel source;
  source.words = gray_words(gray);
  source.size = gray.size();
  const Eigen::Matrix3d to = matrix_of(camera);
  const Eigen::Matrix3d from = matrix_of(reference);
  const Eigen::Matrix3d& rotation = source_from_reference.rotation;
  const Eigen::Vector3d& translation = source_from_reference.translation;
  copy(to * rotation * from.inverse(), source.to_source);
  copy(to * translation, source.to_source_w);
  copy(from * rotation.transpose() * to.inverse(), source.to_reference);
  copy(-from * rotation.transpose() * translation, source.to_reference_w);
  return source;
}

PlaneField::PlaneField(cv::Size its_size, int its_sources) : size(its_size), sources(its_sources) {
  const auto count = static_cast<std::size_t>(size.area());
  planes.resize(count);
  costs.assign(count, kMaxCost);
  view_costs.assign(count * static_cast<std::size_t>(sources),
                    static_cast<std::uint16_t>(kMaxCost * kCostUnit));
}

PlaneField enlarged(const PlaneField& coarse, cv::Size size) {
  PlaneField fine(size, coarse.sources);
  const float scale_x = static_cast<float>(coarse.size.width) / static_cast<float>(size.width);
  const float scale_y = static_cast<float>(coarse.size.height) / static_cast<float>(size.height);
  for (int y = 0; y < size.height; ++y) {
    const float v = (static_cast<float>(y) + 0.5F) * scale_y - 0.5F;
    const int row = std::clamp(static_cast<int>(std::lround(v)), 0, coarse.size.height - 1);
    for (int x = 0; x < size.width; ++x) {
      const float u = (static_cast<float>(x) + 0.5F) * scale_x - 0.5F;
      const int column = std::clamp(static_cast<int>(std::lround(u)), 0, coarse.size.width - 1);
      const Plane& plane = coarse.planes[coarse.index(column, row)];
      fine.planes[fine.index(x, y)] = {plane.inverse_depth +
                                           plane.slope_x * (u - static_cast<float>(column)) +
                                           plane.slope_y * (v - static_cast<float>(row)),
                                       plane.slope_x * scale_x, plane.slope_y * scale_y};
    }
  }
  return fine;
}

}  // namespace tarsier::sfm
