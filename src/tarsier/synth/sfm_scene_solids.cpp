// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene_solids.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace tarsier::synth {
namespace {

// The part of a ray that is inside all planes processed so far.
struct Span {
  double enter = 0;
  double leave = kMaxDistance;
  int face = -1;  // face of entry

  // Clips to the space between two planes perpendicular to an axis; `low` and `high` are their
  // faces.
  bool cut(double origin, double direction, double from, double to, int low, int high) {
    const double inverse = 1 / direction;  // infinite if parallel: the comparisons remain valid
    double first = (from - origin) * inverse;
    double last = (to - origin) * inverse;
    int side = low;
    if (first > last) {
      std::swap(first, last);
      side = high;
    }
    if (first > enter) {
      enter = first;
      face = side;
    }
    leave = std::min(leave, last);
    return enter < leave;
  }

  // Clips to the space below a plane: value + t * slope <= 0.
  bool cut_below(double value, double slope, int side) {
    if (slope < 0) {
      const double t = -value / slope;
      if (t > enter) {
        enter = t;
        face = side;
      }
    } else if (slope > 0) {
      leave = std::min(leave, -value / slope);
    } else if (value > 0) {
      return false;
    }
    return enter < leave;
  }

  bool cut_round(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double radius) {
    const double a = direction.head<2>().squaredNorm();
    const double b = origin.head<2>().dot(direction.head<2>());
    const double c = origin.head<2>().squaredNorm() - radius * radius;
    const double under = b * b - a * c;
    if (under <= 0) return false;
    const double root = std::sqrt(under);
    const double first = (-b - root) / a;
    if (first > enter) {
      enter = first;
      face = 0;
    }
    leave = std::min(leave, (-b + root) / a);
    return enter < leave;
  }
};

}  // namespace

bool Solid::contains(const Eigen::Vector3d& at) const {
  const Eigen::Vector3d local = to_local(at - Eigen::Vector3d(x, y, 0));
  if (local[2] >= top || (bottom > 0 && local[2] <= bottom)) return false;
  if (form == Form::kColumn) return local.head<2>().norm() < half[0];
  if (std::abs(local[0]) >= half[0] || std::abs(local[1]) >= half[1]) return false;
  return form == Form::kBox || local[2] < top - (top - bottom) * std::abs(local[1]) / half[1];
}

Eigen::Vector3d Solid::normal(int face, const Eigen::Vector3d& local) const {
  if (face == kTopFace) return {0, 0, 1};
  if (face == kBottomFace) return {0, 0, -1};
  if (form == Form::kColumn) return Eigen::Vector3d(local[0], local[1], 0).normalized();
  const double sign = face % 2 == 1 ? 1 : -1;
  if (face < 2) return {sign, 0, 0};
  if (form == Form::kGable) return Eigen::Vector3d(0, sign * (top - bottom), half[1]).normalized();
  return {0, sign, 0};
}

cv::Point2d Solid::on_face(int face, const Eigen::Vector3d& local) const {
  if (face == kTopFace) return {local[0], local[1]};
  if (face == kBottomFace) return {local[0], -local[1]};
  double v = local[2] - (bottom + top) / 2;
  if (form == Form::kColumn) return {std::atan2(local[1], local[0]) * half[0], v};
  if (form == Form::kGable && face >= 2) v *= std::hypot(half[1], top - bottom) / (top - bottom);
  const double u = face == 0 ? -local[1] : face == 1 ? local[1] : face == 2 ? local[0] : -local[0];
  return {u, v};
}

cv::Size2d Solid::size_of(int face) const {
  if (form == Form::kColumn && face < kTopFace)
    return {2 * std::numbers::pi * half[0], top - bottom};
  if (face >= kTopFace) return {2 * half[0], 2 * (form == Form::kColumn ? half[0] : half[1])};
  const double height =
      form == Form::kGable && face >= 2 ? std::hypot(half[1], top - bottom) : top - bottom;
  return {2 * (face < 2 ? half[1] : half[0]), height};
}

void intersect(const Solid& solid, int number, const Eigen::Vector3d& origin,
               const Eigen::Vector3d& direction, Hit& hit) {
  Span span;
  span.leave = hit.t;
  bool is_intersected = false;
  switch (solid.form) {
    case Solid::Form::kBox:
      is_intersected =
          span.cut(origin[0], direction[0], -solid.half[0], solid.half[0], 0, 1) &&
          span.cut(origin[1], direction[1], -solid.half[1], solid.half[1], 2, 3) &&
          span.cut(origin[2], direction[2], solid.bottom, solid.top, kBottomFace, kTopFace);
      break;
    case Solid::Form::kColumn:
      is_intersected =
          span.cut(origin[2], direction[2], solid.bottom, solid.top, kBottomFace, kTopFace) &&
          span.cut_round(origin, direction, solid.half[0]);
      break;
    case Solid::Form::kGable: {
      const double rise = solid.top - solid.bottom;
      const double above = solid.half[1] * (origin[2] - solid.top);
      const double climb = solid.half[1] * direction[2];
      is_intersected = span.cut(origin[0], direction[0], -solid.half[0], solid.half[0], 0, 1) &&
                       span.cut_below(solid.bottom - origin[2], -direction[2], kBottomFace) &&
                       span.cut_below(above - rise * origin[1], climb - rise * direction[1], 2) &&
                       span.cut_below(above + rise * origin[1], climb + rise * direction[1], 3);
      break;
    }
  }
  if (is_intersected && span.face >= 0) hit = {span.enter, number, span.face, true};
}

}  // namespace tarsier::synth
