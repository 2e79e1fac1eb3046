// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/quads.h"

#include "tarsier/core/require.h"

#include <Eigen/Eigenvalues>
#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string>

namespace tarsier::planar::markers {
namespace {

using Eigen::Vector2d;

// Quads with corners nearer than this share of the side are duplicates.
constexpr double kMaxDuplicateDistance = 0.12;

struct Line {
  Vector2d point;
  Vector2d direction;  // unit vector
};

std::optional<Vector2d> crossing(const Line& a, const Line& b) {
  const double cross = a.direction.x() * b.direction.y() - a.direction.y() * b.direction.x();
  if (std::abs(cross) < 0.05) return std::nullopt;  // nearly parallel
  const Vector2d d = b.point - a.point;
  return a.point + a.direction * ((d.x() * b.direction.y() - d.y() * b.direction.x()) / cross);
}

// Total least squares with weights.
Line line_through(const std::vector<Vector2d>& points, const std::vector<double>& weights) {
  Vector2d mean(0, 0);
  double sum = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    mean += weights[i] * points[i];
    sum += weights[i];
  }
  mean /= sum;
  double xx = 0;
  double xy = 0;
  double yy = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vector2d d = points[i] - mean;
    xx += weights[i] * d.x() * d.x();
    xy += weights[i] * d.x() * d.y();
    yy += weights[i] * d.y() * d.y();
  }
  const double angle = 0.5 * std::atan2(2 * xy, xx - yy);
  return {mean, {std::cos(angle), std::sin(angle)}};
}

double side(const Quad& quad, std::size_t k) { return (quad[(k + 1) % 4] - quad[k]).norm(); }

double shortest(const Quad& quad) {
  return std::min({side(quad, 0), side(quad, 1), side(quad, 2), side(quad, 3)});
}

bool is_convex(const Quad& quad) {
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector2d a = quad[(k + 1) % 4] - quad[k];
    const Vector2d b = quad[(k + 2) % 4] - quad[(k + 1) % 4];
    // Clockwise in the image is positive because y points down. Corners of less than about 10
    // degrees do not belong to a marker.
    if (a.x() * b.y() - a.y() * b.x() < 0.17 * a.norm() * b.norm()) return false;
  }
  return true;
}

// The contour point farthest from `from`.
std::size_t farthest(std::span<const cv::Point> contour, const cv::Point& from) {
  std::size_t best = 0;
  int max_square = -1;
  for (std::size_t i = 0; i < contour.size(); ++i) {
    const cv::Point d = contour[i] - from;
    const int square = d.dot(d);
    if (square > max_square) {
      max_square = square;
      best = i;
    }
  }
  return best;
}

// Four corners of a closed contour, by index, in its order: its two farthest points, then the
// farthest from their chord on either side.
std::optional<std::array<std::size_t, 4>> corners_of(std::span<const cv::Point> contour) {
  const std::size_t c = farthest(contour, contour[farthest(contour, contour[0])]);
  const std::size_t a = farthest(contour, contour[c]);
  const cv::Point chord = contour[c] - contour[a];
  std::size_t b = a;
  std::size_t d = a;
  int max_b = 0;
  int max_d = 0;
  for (std::size_t i = 0; i < contour.size(); ++i) {
    const cv::Point v = contour[i] - contour[a];
    const int height = chord.x * v.y - chord.y * v.x;
    if (height > max_b) {
      max_b = height;
      b = i;
    }
    if (-height > max_d) {
      max_d = -height;
      d = i;
    }
  }
  const double min_height = 0.1 * chord.dot(chord);
  if (max_b < min_height || max_d < min_height) return std::nullopt;
  std::array<std::size_t, 4> corners{a, b, c, d};
  std::sort(corners.begin(), corners.end());
  return corners;
}

// Fits lines to the contour's points near each side; they intersect at the corners. Outwards the
// contour must stay within `tolerance` px of the chords. Inwards it may deviate on up to half of a
// side, because blur may let a white cell break through the frame.
std::optional<Quad> quad_of(std::span<const cv::Point> contour,
                            const std::array<std::size_t, 4>& corners, double tolerance) {
  const std::size_t n = contour.size();
  std::array<Line, 4> lines;
  std::vector<Vector2d> points;
  std::vector<double> weights;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t first = corners[k];
    const std::size_t last = corners[(k + 1) % 4];
    const std::size_t count = (last + n - first) % n;
    const cv::Point along = contour[last] - contour[first];
    const int steps = std::max(std::abs(along.x), std::abs(along.y));
    if (steps < 3) return std::nullopt;
    const double size = std::hypot(along.x, along.y);
    points.clear();
    int near = 0;
    for (std::size_t i = 1; i < count; ++i) {
      const cv::Point& p = contour[(first + i) % n];
      const cv::Point v = p - contour[first];
      const double inwards = (along.x * v.y - along.y * v.x) / size;
      if (inwards < -tolerance) return std::nullopt;
      if (inwards > tolerance) continue;
      ++near;
      const double share = along.dot(v) / (size * size);
      if (share > 0.1 && share < 0.9) points.emplace_back(p.x, p.y);
    }
    if (2 * near < steps || points.size() < 2) return std::nullopt;
    weights.assign(points.size(), 1);
    lines[k] = line_through(points, weights);
  }
  Quad quad;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto corner = crossing(lines[(k + 3) % 4], lines[k]);
    if (!corner) return std::nullopt;
    quad[k] = *corner;
  }
  return quad;
}

bool is_known(const std::vector<Quad>& quads, const Quad& quad) {
  const double near = kMaxDuplicateDistance * shortest(quad) + 1;
  return std::any_of(quads.begin(), quads.end(), [&](const Quad& other) {
    for (std::size_t turn = 0; turn < 4; ++turn) {
      bool is_same = true;
      for (std::size_t k = 0; k < 4 && is_same; ++k)
        is_same = (quad[k] - other[(k + turn) % 4]).norm() < near;
      if (is_same) return true;
    }
    return false;
  });
}

float sample(const cv::Mat& gray, double x, double y) {
  const int x0 = static_cast<int>(std::floor(x));
  const int y0 = static_cast<int>(std::floor(y));
  const auto fx = static_cast<float>(x - x0);
  const auto fy = static_cast<float>(y - y0);
  const auto* a = gray.ptr<std::uint8_t>(y0) + x0;
  const auto* b = gray.ptr<std::uint8_t>(y0 + 1) + x0;
  const float upper = static_cast<float>(a[0]) + fx * static_cast<float>(a[1] - a[0]);
  const float lower = static_cast<float>(b[0]) + fx * static_cast<float>(b[1] - b[0]);
  return upper + fy * (lower - upper);
}

// Position of the brightness increase along the normal (outwards), px from `at`; nothing without an
// edge. The weight is the height of the step.
std::optional<std::pair<double, double>> edge_along(const cv::Mat& gray, const Vector2d& at,
                                                    const Vector2d& normal, double reach) {
  constexpr double kStep = 0.5;
  int inner = -static_cast<int>(std::ceil(reach / kStep)) - 1;
  int outer = -inner;
  const auto is_inside = [&](int i) {
    const Vector2d p = at + (i * kStep) * normal;
    return p.x() >= 0 && p.y() >= 0 && p.x() < gray.cols - 1.001 && p.y() < gray.rows - 1.001;
  };
  // At the image's border, shortens the range, if the rest is long enough for an edge.
  while (outer > 2 && !is_inside(outer)) --outer;
  while (inner < -2 && !is_inside(inner)) ++inner;
  if (!is_inside(outer) || !is_inside(inner)) return std::nullopt;
  const Vector2d low = at + (inner * kStep) * normal;
  float before = sample(gray, low.x(), low.y());
  double sum = 0;
  double moment = 0;
  double max_rise = 0;
  for (int i = inner + 1; i <= outer; ++i) {
    const Vector2d p = at + (i * kStep) * normal;
    const float now = sample(gray, p.x(), p.y());
    const auto rise = static_cast<double>(now - before);
    before = now;
    if (rise <= 0) continue;
    // Squared, so that the step dominates slow changes of light.
    const double weight = rise * rise;
    sum += weight;
    moment += weight * (i - 0.5) * kStep;
    max_rise = std::max(max_rise, rise);
  }
  if (max_rise < 2) return std::nullopt;
  return std::pair{moment / sum, max_rise};
}

}  // namespace

std::vector<Quad> find_quads(const cv::Mat& gray, const QuadOptions& options, QuadWorkspace& w,
                             DebugSink* debug) {
  options.check();
  TARSIER_REQUIRE(gray.type() == CV_8UC1, "an image that is not grey");
  std::vector<Quad> quads;
  if (gray.cols < 8 || gray.rows < 8) return quads;
  cv::Mat image = gray;
  for (int level = 0; level <= options.halvings; ++level) {
    if (level > 0) {
      cv::Mat& smaller = level % 2 == 1 ? w.half : w.other_half;
      cv::resize(image, smaller, {image.cols / 2, image.rows / 2}, 0, 0, cv::INTER_AREA);
      image = smaller;
    }
    if (image.cols < 8 || image.rows < 8) break;
    const double scale = 1 << level;
    OutlineOptions outlines;
    // Means of four pixels have half the noise.
    outlines.min_contrast =
        std::max(2, level == 0 ? options.min_contrast : options.min_contrast * 3 / 5);
    outlines.min_size = std::max(3, static_cast<int>(options.min_side_px / scale));
    find_dark_outlines(image, outlines, w.outlines);
    if (debug != nullptr) {
      const cv::Mat dark(image.rows + 2, image.cols + 2, CV_8UC1, w.outlines.dark.data());
      debug->image(level == 0 ? std::string("dark") : fmt::format("dark reduced by {}", 1 << level),
                   dark(cv::Rect(1, 1, image.cols, image.rows)));
    }
    for (std::size_t i = 0; i < w.outlines.outlines.size(); ++i) {
      const auto contour = w.outlines.outline(i);
      const auto length = static_cast<double>(contour.size());
      if (length < 3.2 * options.min_side_px / scale) continue;
      const auto corners = corners_of(contour);
      if (!corners) continue;
      auto quad = quad_of(contour, *corners, std::max(2.0, options.max_deviation * length / 2));
      if (!quad) continue;
      // The centre of a pixel of the smaller image lies between pixels of the larger one.
      for (Vector2d& corner : *quad) corner = corner * scale + Vector2d::Constant((scale - 1) / 2);
      if (!is_convex(*quad) || shortest(*quad) < options.min_side_px) continue;
      if (!is_known(quads, *quad)) quads.push_back(*quad);
    }
  }
  return quads;
}

bool refine_quad(const cv::Mat& gray, const RefineOptions& options, Quad& quad) {
  std::array<Line, 4> lines;
  std::vector<Vector2d> points;
  std::vector<double> weights;
  std::vector<double> heights;
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector2d a = quad[k];
    const Vector2d along = quad[(k + 1) % 4] - a;
    const double length = along.norm();
    if (length < 3) return false;
    // Outwards: clockwise sides have their outside on the left.
    const Vector2d normal = Vector2d(along.y(), -along.x()) / length;
    const int count = std::clamp(static_cast<int>(length), 4, options.samples);
    points.clear();
    heights.clear();
    // Blur rounds the corners, so they are excluded.
    const double room = std::min(0.25, std::max(0.08, 2.0 / length));
    for (int i = 0; i < count; ++i) {
      const double share = room + (1 - 2 * room) * (i + 0.5) / count;
      const Vector2d at = a + share * along;
      const auto edge = edge_along(gray, at, normal, options.reach_px);
      if (!edge) continue;
      points.emplace_back(at + edge->first * normal);
      heights.push_back(edge->second);
    }
    if (static_cast<int>(points.size()) < std::max(3, count / 3)) return false;
    // Robust: points far from the line get lower weights.
    weights = heights;
    Line line = line_through(points, weights);
    for (int round = 0; round < 3; ++round) {
      const Vector2d across(-line.direction.y(), line.direction.x());
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double off = (points[i] - line.point).dot(across) / 0.3;
        weights[i] = heights[i] / ((1 + off * off) * (1 + off * off));
      }
      line = line_through(points, weights);
    }
    lines[k] = line;
  }
  Quad refined;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto corner = crossing(lines[(k + 3) % 4], lines[k]);
    if (!corner || (*corner - quad[k]).norm() > 3 * options.reach_px) return false;
    refined[k] = *corner;
  }
  if (!is_convex(refined)) return false;
  quad = refined;
  return true;
}

}  // namespace tarsier::planar::markers
