// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/quad.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::plate {
namespace {

cv::Rect2f upright(const Quad& quad) {
  float left = quad[0].x;
  float right = left;
  float top = quad[0].y;
  float bottom = top;
  for (const cv::Point2f& p : quad) {
    left = std::min(left, p.x);
    right = std::max(right, p.x);
    top = std::min(top, p.y);
    bottom = std::max(bottom, p.y);
  }
  return {left, top, right - left, bottom - top};
}

}  // namespace

Quad quad_of(const cv::Rect2f& box) {
  return {cv::Point2f{box.x, box.y}, cv::Point2f{box.x + box.width, box.y},
          cv::Point2f{box.x + box.width, box.y + box.height},
          cv::Point2f{box.x, box.y + box.height}};
}

cv::Matx33d map_between(const Quad& from, const Quad& to) {
  if (!is_convex(from, 1e-3F) || !is_convex(to, 1e-3F)) return cv::Matx33d::eye();
  const cv::Mat map = cv::getPerspectiveTransform(from.data(), to.data());
  return cv::Matx33d(map.ptr<double>());
}

cv::Point2f transformed(const cv::Matx33d& map, cv::Point2f point) {
  const cv::Vec3d p = map * cv::Vec3d(point.x, point.y, 1);
  const double w = std::abs(p[2]) < 1e-9 ? 1e-9 : p[2];
  return {static_cast<float>(p[0] / w), static_cast<float>(p[1] / w)};
}

Quad transformed(const cv::Matx33d& map, const Quad& quad) {
  Quad result;
  std::transform(quad.begin(), quad.end(), result.begin(),
                 [&](cv::Point2f p) { return transformed(map, p); });
  return result;
}

float area(const Quad& quad) {
  float sum = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const cv::Point2f& a = quad[i];
    const cv::Point2f& b = quad[(i + 1) % 4];
    sum += a.x * b.y - b.x * a.y;
  }
  return sum / 2;
}

float mean_width(const Quad& quad) {
  return static_cast<float>(cv::norm(quad[1] - quad[0]) + cv::norm(quad[2] - quad[3])) / 2;
}

float mean_height(const Quad& quad) {
  return static_cast<float>(cv::norm(quad[3] - quad[0]) + cv::norm(quad[2] - quad[1])) / 2;
}

bool is_convex(const Quad& quad, float min_area) {
  for (std::size_t i = 0; i < 4; ++i) {
    if (!std::isfinite(quad[i].x) || !std::isfinite(quad[i].y)) return false;
    const cv::Point2f a = quad[(i + 1) % 4] - quad[i];
    const cv::Point2f b = quad[(i + 2) % 4] - quad[(i + 1) % 4];
    if (a.cross(b) <= 0) return false;
  }
  return area(quad) >= min_area;
}

Quad grow(const Quad& quad, float along, float across) {
  const float l = 0.5F - along / 2;
  const float t = 0.5F - across / 2;
  const auto at = [&](float u, float v) {
    return quad[0] * ((1 - u) * (1 - v)) + quad[1] * (u * (1 - v)) + quad[2] * (u * v) +
           quad[3] * ((1 - u) * v);
  };
  return {at(l, t), at(1 - l, t), at(1 - l, 1 - t), at(l, 1 - t)};
}

Quad part_of(const Quad& quad, float left, float right, float top, float bottom) {
  const cv::Matx33d map = map_between(quad_of({0, 0, 1, 1}), quad);
  return transformed(map, quad_of({left, top, right - left, bottom - top}));
}

float box_iou(const Quad& a, const Quad& b) { return iou(upright(a), upright(b)); }

float box_overlap_of_smaller(const Quad& a, const Quad& b) {
  return overlap_of_smaller(upright(a), upright(b));
}

cv::Mat sample(const cv::Mat& gray, const Quad& in_image, const Quad& in_canvas, cv::Size canvas) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "an image of type {}", gray.type());
  cv::Matx33d image_from_canvas = map_between(in_canvas, in_image);
  const Quad frame = transformed(
      image_from_canvas,
      quad_of({0, 0, static_cast<float>(canvas.width - 1), static_cast<float>(canvas.height - 1)}));
  cv::Rect2f reach = upright(frame);
  const cv::Rect2f whole(0, 0, static_cast<float>(gray.cols), static_cast<float>(gray.rows));
  reach = cv::Rect2f(reach.x - 3, reach.y - 3, reach.width + 7, reach.height + 7) & whole;
  if (reach.width < 1 || reach.height < 1) return cv::Mat(canvas, CV_8UC1, cv::Scalar(0));
  const cv::Rect window = cv::Rect(reach) & cv::Rect(0, 0, gray.cols, gray.rows);
  if (window.empty()) return cv::Mat(canvas, CV_8UC1, cv::Scalar(0));
  cv::Mat source = gray(window);
  // Pixels of the image per pixel of the canvas.
  const double ratio =
      std::sqrt(std::max(1e-6F, std::abs(area(in_image))) / std::max(1e-6F, area(in_canvas)));
  double scale = 1;
  if (ratio > 1.4) {
    scale = 1 / ratio;
    const cv::Size small(std::max(1, static_cast<int>(std::lround(window.width * scale))),
                         std::max(1, static_cast<int>(std::lround(window.height * scale))));
    cv::Mat reduced;
    cv::resize(source, reduced, small, 0, 0, cv::INTER_AREA);
    const double sx = static_cast<double>(small.width) / window.width;
    const double sy = static_cast<double>(small.height) / window.height;
    image_from_canvas = cv::Matx33d(sx, 0, sx * (0.5 - window.x) - 0.5, 0, sy,
                                    sy * (0.5 - window.y) - 0.5, 0, 0, 1) *
                        image_from_canvas;
    source = reduced;
  } else {
    image_from_canvas = cv::Matx33d(1, 0, -window.x, 0, 1, -window.y, 0, 0, 1) * image_from_canvas;
  }
  cv::Mat result;
  cv::warpPerspective(source, result, cv::Mat(image_from_canvas), canvas,
                      cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  return result;
}

}  // namespace tarsier::plate
