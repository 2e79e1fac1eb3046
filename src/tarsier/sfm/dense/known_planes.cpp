// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/known_planes.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace tarsier::sfm {
namespace {

struct Known {
  cv::Point2f pixel;
  float inverse_depth = 0;
};

// At the scale of `camera`; only the nearest point per pixel.
std::vector<Known> scaled_points(const MatchProblem& problem, const geometry::Camera& camera) {
  const double sx = static_cast<double>(camera.width) / problem.reference.camera.width;
  const double sy = static_cast<double>(camera.height) / problem.reference.camera.height;
  std::map<std::pair<int, int>, Known> nearest;
  for (const KnownDepth& known : problem.known) {
    const cv::Point2f pixel(static_cast<float>((known.pixel.x + 0.5) * sx - 0.5),
                            static_cast<float>((known.pixel.y + 0.5) * sy - 0.5));
    if (!(pixel.x >= 0 && pixel.y >= 0 && pixel.x <= static_cast<float>(camera.width - 1) &&
          pixel.y <= static_cast<float>(camera.height - 1) && known.depth >= problem.min_depth &&
          known.depth <= problem.max_depth))
      continue;
    const auto inverse = static_cast<float>(1 / known.depth);
    Known& entry =
        nearest[{static_cast<int>(std::lround(pixel.y)), static_cast<int>(std::lround(pixel.x))}];
    if (inverse > entry.inverse_depth) entry = {pixel, inverse};
  }
  std::vector<Known> points;
  points.reserve(nearest.size());
  for (const auto& [index, known] : nearest) points.push_back(known);
  return points;
}

// Takes the nearest point for each pixel, by a distance transform.
void fill_from_nearest(const std::vector<Known>& points, cv::Size size,
                       std::vector<Plane>& planes) {
  cv::Mat1b holes(size, 255);
  for (const Known& known : points)
    holes(static_cast<int>(std::lround(known.pixel.y)),
          static_cast<int>(std::lround(known.pixel.x))) = 0;
  cv::Mat distances;
  cv::Mat labels;
  cv::distanceTransform(holes, distances, labels, cv::DIST_L2, 5, cv::DIST_LABEL_PIXEL);
  std::map<int, float> depth_of;
  for (const Known& known : points) {
    depth_of[labels.at<int>(static_cast<int>(std::lround(known.pixel.y)),
                            static_cast<int>(std::lround(known.pixel.x)))] = known.inverse_depth;
  }
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const auto found = depth_of.find(labels.at<int>(y, x));
      if (found != depth_of.end())
        planes[static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width) +
               static_cast<std::size_t>(x)] = {found->second, 0, 0};
    }
  }
}

void fill_triangle(const std::array<Known, 3>& corners, cv::Size size, std::vector<Plane>& planes) {
  const auto& [a, b, c] = corners;
  const cv::Point2f ab = b.pixel - a.pixel;
  const cv::Point2f ac = c.pixel - a.pixel;
  const float area = ab.x * ac.y - ab.y * ac.x;
  if (!(std::abs(area) > 0.5F)) return;
  const float wb = b.inverse_depth - a.inverse_depth;
  const float wc = c.inverse_depth - a.inverse_depth;
  const float slope_x = (wb * ac.y - wc * ab.y) / area;
  const float slope_y = (wc * ab.x - wb * ac.x) / area;
  const auto low = [](float p, float q, float r) {
    return static_cast<int>(std::ceil(std::min({p, q, r})));
  };
  const auto high = [](float p, float q, float r) {
    return static_cast<int>(std::floor(std::max({p, q, r})));
  };
  const int bottom = std::min(high(a.pixel.y, b.pixel.y, c.pixel.y), size.height - 1);
  const int right = std::min(high(a.pixel.x, b.pixel.x, c.pixel.x), size.width - 1);
  for (int y = std::max(low(a.pixel.y, b.pixel.y, c.pixel.y), 0); y <= bottom; ++y) {
    for (int x = std::max(low(a.pixel.x, b.pixel.x, c.pixel.x), 0); x <= right; ++x) {
      const cv::Point2f p(static_cast<float>(x) - a.pixel.x, static_cast<float>(y) - a.pixel.y);
      const float u = (p.x * ac.y - p.y * ac.x) / area;
      const float v = (ab.x * p.y - ab.y * p.x) / area;
      if (u < 0 || v < 0 || u + v > 1) continue;
      planes[static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width) +
             static_cast<std::size_t>(x)] = {a.inverse_depth + slope_x * p.x + slope_y * p.y,
                                             slope_x, slope_y};
    }
  }
}

}  // namespace

std::vector<Plane> known_planes(const MatchProblem& problem, const geometry::Camera& camera) {
  const cv::Size size(camera.width, camera.height);
  const auto mean_inverse_depth =
      static_cast<float>(0.5 * (1 / problem.min_depth + 1 / problem.max_depth));
  std::vector<Plane> planes(static_cast<std::size_t>(size.area()), Plane{mean_inverse_depth, 0, 0});
  const std::vector<Known> points = scaled_points(problem, camera);
  if (points.empty()) return planes;
  fill_from_nearest(points, size, planes);
  if (points.size() < 3) return planes;
  cv::Subdiv2D subdivision(cv::Rect(-1, -1, size.width + 2, size.height + 2));
  std::map<std::pair<float, float>, float> depth_of;
  for (const Known& known : points) {
    subdivision.insert(known.pixel);
    depth_of[{known.pixel.x, known.pixel.y}] = known.inverse_depth;
  }
  std::vector<cv::Vec6f> triangles;
  subdivision.getTriangleList(triangles);
  for (const cv::Vec6f& triangle : triangles) {
    std::array<Known, 3> corners;
    bool is_known = true;
    for (int k = 0; k < 3; ++k) {
      const auto found = depth_of.find({triangle[2 * k], triangle[2 * k + 1]});
      is_known = is_known && found != depth_of.end();
      if (is_known) {
        corners[static_cast<std::size_t>(k)] = {{triangle[2 * k], triangle[2 * k + 1]},
                                                found->second};
      }
    }
    if (is_known) fill_triangle(corners, size, planes);
  }
  return planes;
}

}  // namespace tarsier::sfm
