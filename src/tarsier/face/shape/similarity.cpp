// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/similarity.h"

#include "tarsier/core/require.h"

#include <cmath>

namespace tarsier::face::shape {

double Similarity2d::scale() const { return std::hypot(a, b); }

double Similarity2d::angle() const { return std::atan2(b, a); }

Eigen::Vector2d Similarity2d::operator()(const Eigen::Vector2d& point) const {
  return {a * point.x() - b * point.y() + tx, b * point.x() + a * point.y() + ty};
}

Eigen::Matrix2Xd Similarity2d::operator()(const Eigen::Matrix2Xd& points) const {
  Eigen::Matrix2Xd result(2, points.cols());
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const double x = points(0, i);
    const double y = points(1, i);
    result(0, i) = a * x - b * y + tx;
    result(1, i) = b * x + a * y + ty;
  }
  return result;
}

Similarity2d Similarity2d::inverse() const {
  const double square = a * a + b * b;
  TARSIER_REQUIRE(square > 0 && std::isfinite(square), "a similarity of scale {}",
                  std::sqrt(square));
  const double ia = a / square;
  const double ib = -b / square;
  return {ia, ib, -(ia * tx - ib * ty), -(ib * tx + ia * ty)};
}

Similarity2d operator*(const Similarity2d& second, const Similarity2d& first) {
  return {second.a * first.a - second.b * first.b, second.b * first.a + second.a * first.b,
          second.a * first.tx - second.b * first.ty + second.tx,
          second.b * first.tx + second.a * first.ty + second.ty};
}

Similarity2d fit_similarity(const Eigen::Matrix2Xd& source, const Eigen::Matrix2Xd& target,
                            const Eigen::VectorXd& weights) {
  const Eigen::Index n = source.cols();
  TARSIER_REQUIRE(target.cols() == n, "{} and {} points", n, target.cols());
  TARSIER_REQUIRE(weights.size() == 0 || weights.size() == n, "{} weights of {} points",
                  weights.size(), n);
  const auto weight_of = [&](Eigen::Index i) {
    // The sum is NaN if any of the four is.
    const double sum = source(0, i) + source(1, i) + target(0, i) + target(1, i);
    if (std::isnan(sum)) return 0.0;
    return weights.size() > 0 ? weights[i] : 1.0;
  };

  double total = 0;
  int count = 0;
  Eigen::Vector2d from = Eigen::Vector2d::Zero();
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
  for (Eigen::Index i = 0; i < n; ++i) {
    const double w = weight_of(i);
    TARSIER_REQUIRE(w >= 0 && std::isfinite(w), "weight {} of point {}", w, i);
    if (w == 0) continue;
    ++count;
    total += w;
    from += w * source.col(i);
    to += w * target.col(i);
  }
  TARSIER_REQUIRE(count >= 2, "{} points that count; two are needed", count);
  from /= total;
  to /= total;

  double dot = 0;
  double cross = 0;
  double square = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const double w = weight_of(i);
    if (w == 0) continue;
    const Eigen::Vector2d p = source.col(i) - from;
    const Eigen::Vector2d q = target.col(i) - to;
    dot += w * p.dot(q);
    cross += w * (p.x() * q.y() - p.y() * q.x());
    square += w * p.squaredNorm();
  }
  // If all points coincide, rounding errors of 1e-16 of the coordinates remain.
  const double min_square = 1e-28 * total * (1e-200 + from.squaredNorm());
  TARSIER_REQUIRE(
      square > min_square && std::isfinite(square) && std::isfinite(dot) && std::isfinite(cross),
      "points of extent {}", std::sqrt(square));
  Similarity2d result{dot / square, cross / square, 0, 0};
  const Eigen::Vector2d moved = result(from);
  result.tx = to.x() - moved.x();
  result.ty = to.y() - moved.y();
  return result;
}

}  // namespace tarsier::face::shape
