// SPDX-License-Identifier: MIT
#include "tarsier/face/head_view/head_view.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace tarsier::face::head_view {
namespace {

// Centre of the visible head, in its frame, mm: between nose and ears.
const Eigen::Vector3d kHeadCenter(0, 30, 40);
constexpr double kMinPx = 16;
constexpr float kMaxGradient = 0.2F;

// The smallest rotation that maps z to the unit vector d, d z > 0.
Eigen::Matrix3d rotation_from_z(const Eigen::Vector3d& d) {
  const Eigen::Matrix3d cross{{0, 0, d[0]}, {0, 0, d[1]}, {-d[0], -d[1], 0}};
  return Eigen::Matrix3d::Identity() + cross + cross * cross * (1 / (1 + d[2]));
}

// The crop. To reduce noise and aliasing, it is first sampled at a power of two times its size.
cv::Mat upright_crop(const cv::Mat& gray, const cv::Point2d& middle, double px_per_mm,
                     double roll_deg) {
  int times = 1;
  while (times < 8 && kSide * times < kSideMm * px_per_mm) times *= 2;
  const int side = kSide * times;
  const double scale = kSideMm * px_per_mm / side;  // image px per crop px
  const double c = scale * std::cos(roll_deg * kRadiansPerDegree);
  const double s = scale * std::sin(roll_deg * kRadiansPerDegree);
  const double half = (side - 1) / 2.0;
  const cv::Matx23d image_from_crop(c, -s, middle.x - c * half + s * half,  //
                                    s, c, middle.y - s * half - c * half);
  cv::Mat large;
  cv::warpAffine(gray, large, image_from_crop, {side, side},
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  if (times == 1) return large;
  cv::Mat crop;
  cv::resize(large, crop, {kSide, kSide}, 0, 0, cv::INTER_AREA);
  return crop;
}

// For a pixel along one axis: the lower cell (-1 .. kCells - 1) and the upper one's share.
struct Share {
  int cell = 0;
  float upper = 0;
};

std::array<Share, kSide> shares() {
  std::array<Share, kSide> result;
  for (int x = 0; x < kSide; ++x) {
    const double at = (x + 0.5) / kCell - 0.5;
    result[static_cast<std::size_t>(x)] = {static_cast<int>(std::floor(at)),
                                           static_cast<float>(at - std::floor(at))};
  }
  return result;
}

using Cells = std::vector<float>;  // of kGradients

std::size_t gradient_index(int row, int column, int orientation) {
  return static_cast<std::size_t>((row * kCells + column) * kOrientations + orientation);
}

Cells histograms(const cv::Mat& crop) {
  static const std::array<Share, kSide> kShares = shares();
  std::array<float, 256> root;
  for (int i = 0; i < 256; ++i)
    root[static_cast<std::size_t>(i)] = std::sqrt(static_cast<float>(i));
  const auto value = [&](int y, int x) {
    return root[crop.at<std::uint8_t>(std::clamp(y, 0, kSide - 1), std::clamp(x, 0, kSide - 1))];
  };
  Cells cells(kGradients, 0.0F);
  for (int y = 0; y < kSide; ++y) {
    const Share& down = kShares[static_cast<std::size_t>(y)];
    for (int x = 0; x < kSide; ++x) {
      const float gx = value(y, x + 1) - value(y, x - 1);
      const float gy = value(y + 1, x) - value(y - 1, x);
      const float length = std::hypot(gx, gy);
      if (length == 0) continue;
      float bin = std::atan2(gy, gx) * (kOrientations / std::numbers::pi_v<float>);
      if (bin < 0) bin += kOrientations;
      const int lower = static_cast<int>(bin);
      const float upper_part = bin - static_cast<float>(lower);
      const Share& right = kShares[static_cast<std::size_t>(x)];
      for (int dy = 0; dy < 2; ++dy) {
        const int row = down.cell + dy;
        if (row < 0 || row >= kCells) continue;
        for (int dx = 0; dx < 2; ++dx) {
          const int column = right.cell + dx;
          if (column < 0 || column >= kCells) continue;
          const float part = length * (dy == 1 ? down.upper : 1 - down.upper) *
                             (dx == 1 ? right.upper : 1 - right.upper);
          cells[gradient_index(row, column, lower % kOrientations)] += part * (1 - upper_part);
          cells[gradient_index(row, column, (lower + 1) % kOrientations)] += part * upper_part;
        }
      }
    }
  }
  return cells;
}

// Sets the view's offsets; its roll must be set. False if a point of the mean head is behind the
// camera.
bool set_offsets(const geometry::Camera& camera, const geometry::Rigid3& camera_from_head,
                 const head::HeadModel& head, const Eigen::Matrix2Xd& points, double px_per_mm,
                 HeadView& view) {
  const auto n = points.cols();
  if (static_cast<Eigen::Index>(head.mirror.size()) != n) return true;
  const double c = std::cos(view.angles.roll_deg * kRadiansPerDegree) / px_per_mm;
  const double s = std::sin(view.angles.roll_deg * kRadiansPerDegree) / px_per_mm;
  Eigen::Matrix2Xf offsets(2, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto pixel = camera.project(camera_from_head * Eigen::Vector3d(head.mean.col(i)));
    if (!pixel) return false;
    const double x = points(0, i) - pixel->x;
    const double y = points(1, i) - pixel->y;
    offsets.col(i) << static_cast<float>(c * x + s * y), static_cast<float>(c * y - s * x);
  }
  Eigen::Matrix2Xf mirrored(2, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto from = offsets.col(head.mirror[static_cast<std::size_t>(i)]);
    mirrored.col(i) << -from[0], from[1];
  }
  view.offsets = offsets.reshaped();
  view.mirrored_offsets = mirrored.reshaped();
  return true;
}

}  // namespace

Eigen::VectorXf gradients_of(const cv::Mat& crop) {
  TARSIER_REQUIRE(crop.type() == CV_8UC1 && crop.rows == kSide && crop.cols == kSide,
                  "a crop of {} x {} px, type {}", crop.cols, crop.rows, crop.type());
  const Cells cells = histograms(crop);
  std::array<float, kCells * kCells> energy{};
  for (int i = 0; i < kCells * kCells; ++i)
    for (int k = 0; k < kOrientations; ++k) {
      const float part = cells[static_cast<std::size_t>(i * kOrientations + k)];
      energy[static_cast<std::size_t>(i)] += part * part;
    }
  // Block (r, c) contains the cells r - 1, r and c - 1, c; cells outside are replaced by border
  // cells.
  constexpr float kFlat = 1e-3F * kCell * kCell;  // smaller values are noise
  const auto block = [&](int r, int c) {
    float sum = kFlat;
    for (int row = r - 1; row <= r; ++row)
      for (int column = c - 1; column <= c; ++column)
        sum += energy[static_cast<std::size_t>(std::clamp(row, 0, kCells - 1) * kCells +
                                               std::clamp(column, 0, kCells - 1))];
    return 1 / std::sqrt(sum);
  };
  Eigen::VectorXf result(kGradients);
  for (int r = 0; r < kCells; ++r) {
    for (int c = 0; c < kCells; ++c) {
      const std::array<float, 4> scales{block(r, c), block(r, c + 1), block(r + 1, c),
                                        block(r + 1, c + 1)};
      for (int k = 0; k < kOrientations; ++k) {
        const float part = cells[gradient_index(r, c, k)];
        float sum = 0;
        for (const float scale : scales) sum += std::min(part * scale, kMaxGradient);
        result[static_cast<Eigen::Index>(gradient_index(r, c, k))] = sum / 4;
      }
    }
  }
  return result;
}

std::optional<HeadView> view_of_head(const cv::Mat& gray, const geometry::Camera& camera,
                                     const geometry::Rigid3& camera_from_head,
                                     const head::HeadModel& head, const Eigen::Matrix2Xd& points) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "an image of type {}", gray.type());
  TARSIER_REQUIRE(points.cols() == head.points(), "{} points, the head has {}", points.cols(),
                  head.points());
  const Eigen::Vector3d middle = camera_from_head * kHeadCenter;
  const double distance = middle.norm();
  if (!(middle[2] > 1) || !std::isfinite(distance)) return std::nullopt;
  const auto pixel = camera.project(middle);
  if (!pixel) return std::nullopt;
  const double px_per_mm = std::sqrt(camera.fx * camera.fy) / middle[2];
  if (kSideMm * px_per_mm < kMinPx) return std::nullopt;
  HeadView view;
  view.camera_from_view = rotation_from_z(middle * (1 / distance));
  view.angles =
      head::angles_of_rotation(view.camera_from_view.transpose() * camera_from_head.rotation);
  if (!set_offsets(camera, camera_from_head, head, points, px_per_mm, view)) return std::nullopt;
  view.gradients = gradients_of(upright_crop(gray, *pixel, px_per_mm, view.angles.roll_deg));
  return view;
}

HeadView mirrored(const HeadView& view) {
  HeadView result = view;
  result.angles.yaw_deg = -view.angles.yaw_deg;
  result.angles.roll_deg = -view.angles.roll_deg;
  const Eigen::Matrix3d flip{{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  result.camera_from_view = flip * view.camera_from_view * flip;
  for (int r = 0; r < kCells; ++r)
    for (int c = 0; c < kCells; ++c)
      for (int k = 0; k < kOrientations; ++k)
        result.gradients[static_cast<Eigen::Index>(
            gradient_index(r, kCells - 1 - c, (kOrientations - k) % kOrientations))] =
            view.gradients[static_cast<Eigen::Index>(gradient_index(r, c, k))];
  result.offsets.swap(result.mirrored_offsets);
  return result;
}

Direction direction_of(const HeadView& view, const Eigen::Vector3d& forward_in_view) {
  const double c = std::cos(view.angles.roll_deg * kRadiansPerDegree);
  const double s = std::sin(view.angles.roll_deg * kRadiansPerDegree);
  const double x = c * forward_in_view[0] + s * forward_in_view[1];
  const double y = -s * forward_in_view[0] + c * forward_in_view[1];
  return {std::atan2(-y, -forward_in_view[2]) / kRadiansPerDegree,
          std::asin(std::clamp(-x, -1.0, 1.0)) / kRadiansPerDegree};
}

Eigen::Matrix3d rotation_towards(const HeadView& view, const Direction& direction) {
  return view.camera_from_view *
         head::rotation_of_angles({direction.yaw_deg, direction.pitch_deg, view.angles.roll_deg});
}

}  // namespace tarsier::face::head_view
