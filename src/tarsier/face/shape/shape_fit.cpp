// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace tarsier::face::shape {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kMaxRounds = 100;
constexpr double kTolerance = 1e-10;  // of b, relative to the greatest deviation

// Closed form for equal weights. Mean and modes are orthogonal to each other and to translations.
// With
//   q = points - centre, u = <mean, q>, v = <J mean, q>, p = modes^T q, r = modes^T J^T q
// (J: rotation by 90 degrees), the optimal scale for a rotation by t is (u cos t + v sin t) /
// |mean|^2, and the optimal scale * b is p cos t + r sin t. The explained part is a quadratic form
// in (cos t, sin t); its principal direction is the optimal t.
class UnweightedFit {
 public:
  UnweightedFit(const ShapeModel& model, const Matrix2Xd& points) : model_(model) {
    centre_ = points.rowwise().mean();
    const Index n = points.cols();
    MatrixXd q(2 * n, 2);
    for (Index i = 0; i < n; ++i) {
      const double x = points(0, i) - centre_.x();
      const double y = points(1, i) - centre_.y();
      q(2 * i, 0) = x;
      q(2 * i + 1, 0) = y;
      q(2 * i, 1) = y;
      q(2 * i + 1, 1) = -x;
    }
    const Eigen::Map<const VectorXd> mean(model.mean.data(), 2 * n);
    square_ = mean.squaredNorm();
    uv_ = q.transpose() * mean;
    extent2_ = q.col(0).squaredNorm();
    pr_.noalias() = model.modes.transpose() * q;
  }

  ShapeFit solve(double sigmas) {
    const auto p = pr_.col(0);
    const auto r = pr_.col(1);
    const double u = uv_[0];
    const double v = uv_[1];
    const double cc = u * u / square_ + p.squaredNorm();
    const double cs = u * v / square_ + p.dot(r);
    const double ss = v * v / square_ + r.squaredNorm();
    const double angle = std::atan2(2 * cs, cc - ss) / 2;
    double c = std::cos(angle);
    double s = std::sin(angle);
    double scale = (c * u + s * v) / square_;
    if (scale < 0) {
      c = -c;
      s = -s;
      scale = -scale;
    }
    b_ = VectorXd::Zero(model_.modes.cols());
    // The points contain nothing of the mean: there is no scale for b.
    if (!(scale * scale * square_ > 1e-12 * extent2_)) return fit_similarity_to_b();
    b_ = (c * p + s * r) / scale;
    if (sigmas > 0 && clamp(model_, b_, sigmas)) descend(sigmas);
    return fit_similarity_to_b();
  }

 private:
  [[nodiscard]] ShapeFit fit_similarity_to_b() const {
    const double square = square_ + b_.squaredNorm();
    return {{(uv_[0] + b_.dot(pr_.col(0))) / square, (uv_[1] + b_.dot(pr_.col(1))) / square,
             centre_.x(), centre_.y()},
            b_};
  }

  // Optimises similarity and b in turn, within the limits.
  void descend(double sigmas) {
    const double tolerance = kTolerance * model_.deviation[0];
    for (int round = 0; round < kMaxRounds; ++round) {
      const Similarity2d t = fit_similarity_to_b().image_from_model;
      const double square = t.a * t.a + t.b * t.b;
      if (!(square > 0)) return;
      VectorXd next = (t.a * pr_.col(0) + t.b * pr_.col(1)) / square;
      clamp(model_, next, sigmas);
      const double change = (next - b_).cwiseAbs().maxCoeff();
      b_ = std::move(next);
      if (change <= tolerance) return;
    }
  }

  const ShapeModel& model_;
  Eigen::Vector2d centre_;
  Eigen::Vector2d uv_;
  MatrixXd pr_;
  VectorXd b_;
  double square_ = 0;
  double extent2_ = 0;
};

// With weights, the modes are not orthogonal. Gauss-Newton over similarity and b together, in the
// model's frame. There, a similarity moves the shape s by multiples of s, J s and translations (J:
// rotation by 90 degrees). These four are eliminated, and the similarity is then fitted again. With
// precomputed sums over the points,
//   s = Q c, Q = (mean, modes), c = (1, b),
// an iteration costs little more than two products with Q. A mode that reaches its limit is fixed
// there while the others are fitted again.
class WeightedFit {
 public:
  WeightedFit(const ShapeModel& model, const Matrix2Xd& points, const VectorXd& weights,
              double noise)
      : model_(model) {
    const Index n = points.cols();
    const Index m = model.modes.cols();
    weights_.resize(2 * n);
    MatrixXd z(2 * n, 2);  // W z, W J^T z
    shift_z_.setZero();
    int count = 0;
    for (Index i = 0; i < n; ++i) {
      const bool is_missing = std::isnan(points(0, i)) || std::isnan(points(1, i));
      const double w = is_missing ? 0 : (weights.size() > 0 ? weights[i] : 1);
      const double x = is_missing ? 0 : w * points(0, i);
      const double y = is_missing ? 0 : w * points(1, i);
      weights_[2 * i] = weights_[2 * i + 1] = w;
      z(2 * i, 0) = x;
      z(2 * i + 1, 0) = y;
      z(2 * i, 1) = y;
      z(2 * i + 1, 1) = -x;
      shift_z_ += Eigen::Vector2d(x, y);
      total_ += w;
      count += w > 0 ? 1 : 0;
    }
    TARSIER_REQUIRE(count >= 2, "{} points that count; two are needed", count);

    columns_.resize(2 * n, 1 + m);
    columns_.col(0) = Eigen::Map<const VectorXd>(model.mean.data(), 2 * n);
    columns_.rightCols(m) = model.modes;
    const MatrixXd scaled = weights_.cwiseSqrt().asDiagonal() * columns_;
    gram_.setZero(1 + m, 1 + m);
    gram_.selfadjointView<Eigen::Lower>().rankUpdate(scaled.transpose());
    gram_.triangularView<Eigen::StrictlyUpper>() = gram_.transpose();
    with_z_.noalias() = columns_.transpose() * z;
    shift_.setZero(1 + m, 2);
    for (Index k = 0; k <= m; ++k) {
      for (Index i = 0; i < n; ++i) {
        shift_(k, 0) += weights_[2 * i] * columns_(2 * i, k);
        shift_(k, 1) += weights_[2 * i] * columns_(2 * i + 1, k);
      }
    }
    set_prior(noise * noise);
    c_ = VectorXd::Zero(1 + m);
    c_[0] = 1;
  }

  ShapeFit solve(double sigmas) {
    converge();
    // Each pass fixes at least one mode.
    const Index m = model_.modes.cols();
    for (Index pass = 0; sigmas > 0 && pass < m; ++pass) {
      bool is_out = false;
      for (Index k = 0; k < m; ++k) {
        double& b = c_[1 + k];
        const double limit = sigmas * model_.deviation[k];
        if (std::abs(b) <= limit) continue;
        b = std::copysign(limit, b);
        is_fixed_[static_cast<std::size_t>(k)] = true;
        is_out = true;
      }
      if (!is_out) break;
      converge();
    }
    return {image_from_model_, c_.tail(m)};
  }

 private:
  void set_prior(double noise2) {
    const Index m = model_.modes.cols();
    // With too few points for all modes, the solution is the one nearest to the mean.
    const double min_noise2 = 1e-14 * weights_.maxCoeff();
    prior_.setZero(m);
    is_fixed_.assign(static_cast<std::size_t>(m), false);
    for (Index k = 0; k < m; ++k) {
      const double deviation = std::max(model_.deviation[k], 1e-4 * model_.deviation[0]);
      is_fixed_[static_cast<std::size_t>(k)] =
          !(deviation > 0) || (noise2 > 0 && !(model_.deviation[k] > 0));
      if (deviation > 0) prior_[k] = std::max(noise2, min_noise2) / (deviation * deviation);
    }
  }

  void converge() {
    fit_similarity_to_c();
    const double tolerance = kTolerance * model_.deviation[0];
    for (int round = 0; round < kMaxRounds && image_from_model_.scale() > 0; ++round) {
      const double change = step();
      fit_similarity_to_c();
      if (!(change > tolerance)) return;
    }
  }

  // The best similarity for the shape of c; its sums are stored for step().
  void fit_similarity_to_c() {
    gram_c_.noalias() = gram_ * c_;
    shift_c_.noalias() = shift_.transpose() * c_;
    square_ = c_.dot(gram_c_) - shift_c_.squaredNorm() / total_;
    TARSIER_REQUIRE(square_ > 1e-20 * total_, "points that coincide in the model");
    const double dot = c_.dot(with_z_.col(0)) - shift_c_.dot(shift_z_) / total_;
    const double cross = c_.dot(with_z_.col(1)) -
                         (shift_c_.x() * shift_z_.y() - shift_c_.y() * shift_z_.x()) / total_;
    const double a = dot / square_;
    const double b = cross / square_;
    image_from_model_ = {a, b, (shift_z_.x() - a * shift_c_.x() + b * shift_c_.y()) / total_,
                         (shift_z_.y() - b * shift_c_.x() - a * shift_c_.y()) / total_};
  }

  // One step of b; returns the greatest change.
  double step() {
    const Index n = weights_.size() / 2;
    const Index m = model_.modes.cols();
    const Similarity2d back = image_from_model_.inverse();
    // modes^T W (back(points) - s), and the gradient of the prior.
    VectorXd right = back.a * with_z_.col(0).tail(m) - back.b * with_z_.col(1).tail(m) +
                     back.tx * shift_.col(0).tail(m) + back.ty * shift_.col(1).tail(m) -
                     gram_c_.tail(m) - prior_.cwiseProduct(c_.tail(m));
    shape_.noalias() = columns_ * c_;
    for (Index i = 0; i < n; ++i) {  // to W J s
      const double x = shape_[2 * i];
      shape_[2 * i] = -weights_[2 * i] * shape_[2 * i + 1];
      shape_[2 * i + 1] = weights_[2 * i] * x;
    }
    const auto sx = shift_.col(0).tail(m);
    const auto sy = shift_.col(1).tail(m);
    scaling_ = gram_c_.tail(m) - (shift_c_.x() * sx + shift_c_.y() * sy) / total_;
    turning_.noalias() = columns_.rightCols(m).transpose() * shape_;
    turning_ -= (shift_c_.x() * sy - shift_c_.y() * sx) / total_;
    normal_ = gram_.bottomRightCorner(m, m);
    normal_.diagonal() += prior_;
    auto lower = normal_.selfadjointView<Eigen::Lower>();
    lower.rankUpdate(sx, -1 / total_);
    lower.rankUpdate(sy, -1 / total_);
    lower.rankUpdate(scaling_, -1 / square_);
    lower.rankUpdate(turning_, -1 / square_);
    for (Index k = 0; k < m; ++k) {
      if (!is_fixed_[static_cast<std::size_t>(k)]) continue;
      normal_.row(k).setZero();
      normal_.col(k).setZero();
      normal_(k, k) = 1;
      right[k] = 0;
    }
    const VectorXd change = linalg::solve_symmetric(normal_, right);
    if (!change.allFinite()) return 0;
    c_.tail(m) += change;
    return change.cwiseAbs().maxCoeff();
  }

  const ShapeModel& model_;
  VectorXd weights_;  // 2n, each twice; 0: missing
  double total_ = 0;  // of the weights
  MatrixXd columns_;  // Q, 2n x (1 + m)
  MatrixXd gram_;     // Q^T W Q
  MatrixXd with_z_;   // Q^T W z, Q^T W J^T z
  MatrixXd shift_;    // Q^T W (1 0 1 0 ..), Q^T W (0 1 0 1 ..)
  Eigen::Vector2d shift_z_;
  VectorXd prior_;
  std::vector<bool> is_fixed_;
  VectorXd c_;
  Similarity2d image_from_model_;
  VectorXd gram_c_;
  Eigen::Vector2d shift_c_;
  double square_ = 0;  // s^T W s about its centre
  VectorXd shape_;
  VectorXd scaling_;  // modes^T W s and modes^T W J s, about the centre
  VectorXd turning_;
  MatrixXd normal_;
};

}  // namespace

ShapeFit fit_shape(const ShapeModel& model, const Matrix2Xd& points, const VectorXd& weights,
                   double sigmas, double noise) {
  TARSIER_REQUIRE(points.cols() == model.mean.cols(), "{} points for a model of {}", points.cols(),
                  model.mean.cols());
  TARSIER_REQUIRE(weights.size() == 0 || weights.size() == points.cols(), "{} weights of {} points",
                  weights.size(), points.cols());
  TARSIER_REQUIRE(std::isfinite(sigmas) && std::isfinite(noise) && noise >= 0,
                  "sigmas {}, noise {}", sigmas, noise);
  TARSIER_REQUIRE(!points.array().isInf().any(), "a point is not finite");
  if (model.modes.cols() == 0)
    return {fit_similarity(model.mean, points, weights), VectorXd::Zero(0)};
  if (weights.size() == 0 && noise == 0 && !points.hasNaN())
    return UnweightedFit(model, points).solve(sigmas);
  TARSIER_REQUIRE(weights.size() == 0 || (weights.allFinite() && weights.minCoeff() >= 0),
                  "a weight is negative or not finite");
  return WeightedFit(model, points, weights, noise).solve(sigmas);
}

}  // namespace tarsier::face::shape
