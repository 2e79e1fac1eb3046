// SPDX-License-Identifier: MIT
#include "tarsier/synth/stroke_pen.h"

#include "tarsier/synth/glyphs.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::synth {
namespace {

constexpr int kOversampling = 2;  // oversampling factor
constexpr double kHeight = kOversampling * GlyphSet::kCapHeight;

}  // namespace

StrokePen::StrokePen(const StrokeStyle& style, double width)
    : style_(style),
      canvas_(cvRound(kHeight), cvRound(kHeight * width), CV_8UC1, cv::Scalar(0)),
      half_x_(style.stem_width * kHeight / 2),
      half_y_(style.bar_width * kHeight / 2),
      box_(canvas_.cols - 2 * half_x_, canvas_.rows - 2 * half_y_) {
  // Bowls have the same roundness in wide and narrow symbols.
  const double base = (style.width - style.stem_width) * kHeight;
  radius_ = {style.round * base, style.round * base * style.bowl_aspect};
}

void StrokePen::bridge(double at) {
  const int gap = std::max(3, cvRound(half_x_ * 0.55));
  const int x = cvRound(canvas_.cols * at);
  cv::rectangle(canvas_, cv::Rect(x - gap / 2, 0, gap, canvas_.rows), cv::Scalar(0), cv::FILLED);
}

void StrokePen::slit(const Vertex& from, const Vertex& to) {
  const int gap = std::max(3, cvRound(half_x_ * 0.6));
  cv::line(canvas_, at(from), at(to), cv::Scalar(0), gap);
}

cv::Mat StrokePen::finished() const {
  cv::Mat soft;
  const int border = 8 * kOversampling;
  cv::copyMakeBorder(canvas_, soft, border, border, border, border, cv::BORDER_CONSTANT,
                     cv::Scalar(0));
  // Paint rounds sharp corners: a blur, and its middle grey as the outline.
  if (style_.blur_px > 1) {
    cv::GaussianBlur(soft, soft, {}, style_.blur_px * kOversampling / 2);
    soft.convertTo(soft, -1, 4, -4 * 127.5 + 127.5);
  }
  cv::resize(soft, soft, {}, 1.0 / kOversampling, 1.0 / kOversampling, cv::INTER_AREA);
  cv::Mat points;
  cv::findNonZero(soft > 60, points);
  return points.empty() ? cv::Mat() : soft(cv::boundingRect(points)).clone();
}

std::vector<StrokePen::Point> StrokePen::curved(const std::vector<Vertex>& path,
                                                bool closed) const {
  std::vector<Point> points;
  const std::size_t n = path.size();
  for (std::size_t i = 0; i < n; ++i) {
    const cv::Point2d corner = at(path[i]);
    const bool end = !closed && (i == 0 || i + 1 == n);
    if (path[i].round <= 0 || end) {
      points.push_back({corner, false});
      continue;
    }
    // Distance along an edge at which the curve begins; two curves share their edge.
    const auto reach = [&](std::size_t other) {
      const cv::Point2d edge = at(path[other]) - corner;
      const double length = std::max(1e-6, cv::norm(edge));
      const bool other_end = !closed && (other == 0 || other + 1 == n);
      const double most = length * (path[other].round > 0 && !other_end ? 0.5 : 0.95);
      const double want =
          path[i].round * (std::abs(edge.x) * radius_.x + std::abs(edge.y) * radius_.y) / length;
      return edge * (std::min(want, most) / length);
    };
    const cv::Point2d a = reach((i + n - 1) % n);
    const cv::Point2d b = reach((i + 1) % n);
    constexpr int kSteps = 12;
    const double power = 2 / style_.power;
    for (int k = 0; k <= kSteps; ++k) {
      const double t = k * CV_PI / 2 / kSteps;
      const double c = std::pow(std::max(0.0, std::cos(t)), power);
      const double s = std::pow(std::max(0.0, std::sin(t)), power);
      points.push_back({corner + a * (1 - s) + b * (1 - c), k > 0 && k < kSteps});
    }
  }
  return points;
}

void StrokePen::fill(const std::array<cv::Point2d, 4>& corners) {
  std::array<cv::Point, 4> fixed;
  for (std::size_t i = 0; i < 4; ++i)
    fixed[i] = {cvRound(corners[i].x * 16), cvRound(corners[i].y * 16)};
  cv::fillConvexPoly(canvas_, fixed.data(), 4, cv::Scalar(255), cv::LINE_8, 4);
}

void StrokePen::dot(cv::Point2d p) {
  cv::ellipse(canvas_, cv::Point(cvRound(p.x * 16), cvRound(p.y * 16)),
              cv::Size(cvRound(half_x_ * 16), cvRound(half_y_ * 16)), 0, 0, 360, cv::Scalar(255),
              cv::FILLED, cv::LINE_8, 4);
}

cv::Point2d StrokePen::across(cv::Point2d d) const {
  return cv::Point2d(-d.y, d.x) * std::hypot(half_x_ * d.y, half_y_ * d.x);
}

cv::Point2d StrokePen::end_of(cv::Point2d p, cv::Point2d d) const {
  if (style_.round_ends) return {0, 0};
  const double half = half_x_ * std::abs(d.x) + half_y_ * std::abs(d.y);
  const bool slants = std::abs(d.x) > 0.05 && std::abs(d.y) > 0.05;
  const bool at_edge = p.y < half_y_ + 1 || p.y > canvas_.rows - half_y_ - 1;
  return d * (slants ? (at_edge ? 1.6 * half : 0) : half);
}

void StrokePen::join(const Point& point, cv::Point2d d, cv::Point2d next) {
  const double length = cv::norm(next - point.at);
  if (length < 1e-6) return;
  const cv::Point2d e = (next - point.at) / length;
  if (point.bend || style_.round_joins || d.dot(e) > 0.97) {
    dot(point.at);
    return;
  }
  // The outer corner: the intersection of the strokes' edges, limited in distance.
  const double turn = d.x * e.y - d.y * e.x;
  const double side = turn > 0 ? -1 : 1;
  const cv::Point2d from = point.at + across(d) * side;
  const cv::Point2d to = point.at + across(e) * side;
  if (std::abs(turn) < 1e-3) return;
  const cv::Point2d gap = to - from;
  const double along = (gap.x * e.y - gap.y * e.x) / turn;
  const double most = 5 * (half_x_ + half_y_);
  fill({point.at, from, from + d * std::clamp(along, 0.0, most), to});
}

void StrokePen::trace(const std::vector<Vertex>& path, bool closed) {
  const std::vector<Point> points = curved(path, closed);
  const std::size_t n = points.size();
  const std::size_t edges = closed ? n : n - 1;
  for (std::size_t i = 0; i < edges; ++i) {
    cv::Point2d a = points[i].at;
    cv::Point2d b = points[(i + 1) % n].at;
    const double length = cv::norm(b - a);
    if (length < 1e-6) continue;
    const cv::Point2d d = (b - a) / length;
    if (!closed && i == 0) a -= end_of(a, d);
    if (!closed && i + 1 == edges) b += end_of(b, d);
    const cv::Point2d o = across(d);
    fill({a + o, b + o, b - o, a - o});
    if (closed || i + 1 < edges) join(points[(i + 1) % n], d, points[(i + 2) % n].at);
  }
  if (style_.round_ends && !closed) {
    dot(points.front().at);
    dot(points.back().at);
  }
}

}  // namespace tarsier::synth
