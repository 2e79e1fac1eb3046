// SPDX-License-Identifier: MIT
#include "tarsier/face/head/draw_pose.h"

#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace tarsier::face::head {
namespace {

constexpr int kShift = 4;  // 1/16 px

int line_width(const cv::Mat& image) {
  return std::max(2, (std::min(image.cols, image.rows) + 120) / 240);
}

// The part of a segment in front of the camera, in px; empty if there is none. It is also clipped
// far outside the image, because drawing uses integers.
std::optional<std::array<cv::Point2d, 2>> visible_part(const geometry::Camera& camera,
                                                       Eigen::Vector3d a, Eigen::Vector3d b) {
  const double near = 1e-3 * std::max(a.norm(), b.norm());
  if (a[2] < near && b[2] < near) return std::nullopt;
  if (a[2] < near) a = b + (a - b) * ((b[2] - near) / (b[2] - a[2]));
  if (b[2] < near) b = a + (b - a) * ((a[2] - near) / (a[2] - b[2]));
  const auto p = camera.project(a);
  const auto q = camera.project(b);
  if (!p || !q) return std::nullopt;
  // Liang-Barsky clipping to a square much larger than any image.
  const double limit = 30000;
  double from = 0;
  double to = 1;
  const cv::Point2d way = *q - *p;
  const auto clip = [&](double start, double step) {
    if (!std::isfinite(start) || !std::isfinite(step)) return false;
    if (std::abs(step) < 1e-12) return std::abs(start) <= limit;
    double first = (-limit - start) / step;
    double second = (limit - start) / step;
    if (first > second) std::swap(first, second);
    from = std::max(from, first);
    to = std::min(to, second);
    return from < to;
  };
  if (!clip(p->x, way.x) || !clip(p->y, way.y)) return std::nullopt;
  return std::array<cv::Point2d, 2>{*p + from * way, *p + to * way};
}

void draw_line(cv::Mat& image, const std::array<cv::Point2d, 2>& ends, const cv::Scalar& color,
               int width) {
  const auto fixed = [](const cv::Point2d& p) {
    return cv::Point(cv::saturate_cast<int>(p.x * (1 << kShift)),
                     cv::saturate_cast<int>(p.y * (1 << kShift)));
  };
  cv::line(image, fixed(ends[0]), fixed(ends[1]), color, width, cv::LINE_AA, kShift);
}

}  // namespace

void draw_axes(cv::Mat& image, const geometry::Camera& camera,
               const geometry::Rigid3& camera_from_object, const Eigen::Vector3d& lengths,
               bool with_names) {
  image::draw::require_canvas(image);
  camera.check();
  struct Axis {
    const char* name;
    cv::Scalar color;
    Eigen::Vector3d end = Eigen::Vector3d::Zero();
  };
  std::array<Axis, 3> axes = {{{"x", {60, 60, 255}}, {"y", {70, 220, 70}}, {"z", {255, 120, 60}}}};
  const Eigen::Vector3d& origin = camera_from_object.translation;
  for (int k = 0; k < 3; ++k) {
    TARSIER_REQUIRE(std::isfinite(lengths[k]), "length {}", lengths[k]);
    Eigen::Vector3d end = Eigen::Vector3d::Zero();
    end[k] = lengths[k];
    axes[static_cast<std::size_t>(k)].end = camera_from_object * end;
  }
  std::stable_sort(axes.begin(), axes.end(),
                   [](const Axis& a, const Axis& b) { return a.end[2] > b.end[2]; });
  const int width = line_width(image);
  for (const Axis& axis : axes) {
    if ((axis.end - origin).norm() == 0) continue;
    const auto ends = visible_part(camera, origin, axis.end);
    if (!ends) continue;
    draw_line(image, *ends, {0, 0, 0}, width + 2);
    draw_line(image, *ends, axis.color, width);
    const cv::Point2d at = (*ends)[1];
    if (!with_names || !(std::abs(at.x) < 20000 && std::abs(at.y) < 20000)) continue;
    // Beyond the end, so that the line does not cross the letter.
    const cv::Point2d way = at - (*ends)[0];
    const double length = std::max(1.0, std::hypot(way.x, way.y));
    const double step = 0.9 * image::draw::fitting_text_height(image.size());
    image::draw::TextStyle style;
    style.color = axis.color;
    style.bold = true;
    image::draw::put_text(image, axis.name,
                          {static_cast<int>(std::lround(at.x + step * way.x / length)),
                           static_cast<int>(std::lround(at.y + step * way.y / length))},
                          style, image::draw::Anchor::kCenter);
  }
}

void draw_box(cv::Mat& image, const geometry::Camera& camera,
              const geometry::Rigid3& camera_from_object, const Eigen::Vector3d& low,
              const Eigen::Vector3d& high, const cv::Scalar& color) {
  image::draw::require_canvas(image);
  camera.check();
  const auto corner = [&](int code) {
    return camera_from_object * Eigen::Vector3d((code & 1) != 0 ? high[0] : low[0],
                                                (code & 2) != 0 ? high[1] : low[1],
                                                (code & 4) != 0 ? high[2] : low[2]);
  };
  // A face is visible if the camera is on its outer side. Face 2 k + s: coordinate k at low (s = 0)
  // or high.
  const Eigen::Vector3d eye = camera_from_object.center();
  std::array<bool, 6> is_seen{};
  for (int k = 0; k < 3; ++k) {
    const double lower = std::min(low[k], high[k]);
    const double upper = std::max(low[k], high[k]);
    const bool flip = low[k] > high[k];
    is_seen[static_cast<std::size_t>(2 * k + (flip ? 1 : 0))] = eye[k] < lower;
    is_seen[static_cast<std::size_t>(2 * k + (flip ? 0 : 1))] = eye[k] > upper;
  }
  const int width = line_width(image);
  for (const bool hidden : {true, false}) {
    for (int from = 0; from < 8; ++from) {
      for (int k = 0; k < 3; ++k) {
        if ((from >> k & 1) != 0) continue;
        bool seen = false;
        for (int other = 0; other < 3; ++other) {
          if (other == k) continue;
          seen = seen || is_seen[static_cast<std::size_t>(2 * other + (from >> other & 1))];
        }
        if (seen == hidden) continue;
        const auto ends = visible_part(camera, corner(from), corner(from | 1 << k));
        if (!ends) continue;
        if (hidden) {
          draw_line(image, *ends, color * 0.5, std::max(1, width / 2));
        } else {
          draw_line(image, *ends, {0, 0, 0}, width + 2);
          draw_line(image, *ends, color, width);
        }
      }
    }
  }
}

void draw_head(cv::Mat& image, const geometry::Camera& camera,
               const geometry::Rigid3& camera_from_head, const HeadModel& model,
               const Eigen::Matrix3Xd& shape, const cv::Scalar& color) {
  image::draw::require_canvas(image);
  camera.check();
  TARSIER_REQUIRE(shape.cols() == model.points(), "a shape of {} points for a model of {}",
                  shape.cols(), model.points());
  const auto placed = [&](int i) { return camera_from_head * shape.col(i); };
  const int width = std::max(1, line_width(image) / 2);
  for (const auto& [a, b] : model.connections) {
    if (const auto ends = visible_part(camera, placed(a), placed(b)))
      draw_line(image, *ends, color, width);
  }
  for (int i = 0; i < model.points(); ++i) {
    const auto pixel = camera.project(placed(i));
    if (pixel && std::abs(pixel->x) < 20000 && std::abs(pixel->y) < 20000)
      image::draw::point(image, *pixel, color, width + 1.0);
  }
}

}  // namespace tarsier::face::head
