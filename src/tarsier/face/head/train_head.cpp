// SPDX-License-Identifier: MIT
#include "tarsier/face/head/train_head.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/head/factorization.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::face::head {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

// The current estimate for one image; `moment` is E[(1, b)(1, b)'], b in units of its deviation.
struct View {
  Matrix2Xd points;  // centred, RMS radius 1
  ScaledOrthography camera;
  VectorXd b;
  MatrixXd moment;
  Matrix2Xd flat;    // the points under scaled orthography
  VectorXd visible;  // 0..1: low on the outline's far side
  VectorXd weight;   // visible times the robust weight
  VectorXd squared;  // expected squared residual of each point
};

struct Trainer {
  const TrainHeadOptions& options;
  const shape::Markup& markup;
  std::vector<char> is_outline;
  std::vector<View> views;
  Matrix3Xd mean;  // mm
  MatrixXd modes;  // 3n x m, scaled so that b has variance 1
  VectorXd noise;  // standard deviation of a coordinate of each point, in units of View::points
  Index n = 0;
  Index m = 0;

  [[nodiscard]] double distance() const { return options.distance_mm; }
  void start();
  void update_visibility(View& view) const;
  void estimate(View& view, int steps) const;
  void update_shape();
  void fix_gauge();
  void update_noise();
};

void Trainer::start() {
  std::vector<Matrix2Xd> faces;
  faces.reserve(views.size());
  for (const View& view : views) faces.push_back(view.points);
  const auto rigid = factorize_symmetric(faces, markup.mirror);
  TARSIER_REQUIRE(rigid.has_value(),
                  "the faces must turn: these {} do not determine the depth of their points",
                  faces.size());
  mean = rigid->shape;
  for (std::size_t f = 0; f < views.size(); ++f) views[f].camera = rigid->cameras[f];
  noise = VectorXd::Constant(n, 0.05);
  m = 0;
  modes.resize(3 * n, 0);
  fix_gauge();
}

// Visibility of the outline by the current yaw. With yaw > 0 the head turns to image left, and the
// outline at image left (x < 0) is the edge of the cheek instead of the jaw.
void Trainer::update_visibility(View& view) const {
  const double yaw = angles_of_rotation(view.camera.rotation).yaw_deg;
  const double far = std::exp(-0.5 * std::pow(yaw / options.outline_yaw_deg, 2));
  for (Index i = 0; i < n; ++i) {
    const bool hidden = is_outline[static_cast<std::size_t>(i)] != 0 && mean(0, i) * yaw < 0;
    view.visible[i] = hidden ? far : 1;
  }
}

// Maximum a posteriori camera and deformation for the current shape (Gauss-Newton). Their
// covariance gives the second moment of b.
void Trainer::estimate(View& view, int steps) const {
  const Index size = 6 + m;
  MatrixXd normal(size, size);
  VectorXd right(size);
  MatrixXd jacobian(2, size);
  Matrix3Xd turned(3, n);
  for (int step = 0; step <= steps; ++step) {
    ScaledOrthography& camera = view.camera;
    Matrix3Xd shape = mean;
    if (m > 0) Eigen::Map<VectorXd>(shape.data(), 3 * n) += modes * view.b;
    turned = camera.rotation * shape;
    normal.setZero();
    right.setZero();
    for (Index i = 0; i < n; ++i) {
      const Vector3d q = turned.col(i);
      // As in POSIT: with known depth, the equations are those of orthography.
      const double factor = 1 + q[2] / distance();
      view.flat.col(i) = camera.shift + factor * (view.points.col(i) - camera.shift);
      const Vector2d residual = view.flat.col(i) - camera.shift - camera.scale * q.head<2>();
      const double sigma = noise[i];
      const double squared_ratio =
          residual.squaredNorm() / std::pow(options.robust_sigmas * sigma, 2);
      view.weight[i] = view.visible[i] / ((1 + squared_ratio) * (1 + squared_ratio));
      jacobian.leftCols(6) << 0, camera.scale * q[2], -camera.scale * q[1], camera.scale * q[0],
          factor, 0, -camera.scale * q[2], 0, camera.scale * q[0], camera.scale * q[1], 0, factor;
      if (m > 0) {
        jacobian.rightCols(m) =
            camera.scale * camera.rotation.topRows<2>() * modes.middleRows(3 * i, 3);
      }
      const double w = view.weight[i] / (sigma * sigma);
      normal.noalias() += w * jacobian.transpose() * jacobian;
      right.noalias() += w * jacobian.transpose() * residual;
    }
    normal.diagonal().tail(m).array() += 1;
    right.tail(m) -= view.b;
    const linalg::Cholesky factor(normal);
    if (step == steps) {
      const MatrixXd covariance = factor.solve(MatrixXd::Identity(size, size));
      VectorXd one(m + 1);
      one << 1, view.b;
      view.moment = one * one.transpose();
      view.moment.bottomRightCorner(m, m) += covariance.bottomRightCorner(m, m);
      for (Index i = 0; i < n; ++i) {
        const Vector2d residual =
            view.flat.col(i) - camera.shift - camera.scale * turned.col(i).head<2>();
        view.squared[i] = residual.squaredNorm();
        if (m > 0) {
          const MatrixXd of_modes =
              camera.scale * camera.rotation.topRows<2>() * modes.middleRows(3 * i, 3);
          view.squared[i] +=
              (of_modes * covariance.bottomRightCorner(m, m) * of_modes.transpose()).trace();
        }
      }
      break;
    }
    const VectorXd update = factor.solve(right);
    const Vector3d spin = update.head<3>();
    if (spin.norm() > 0) {
      camera.rotation =
          Eigen::AngleAxisd(std::min(spin.norm(), 0.3), spin.normalized()) * camera.rotation;
    }
    camera.scale *= std::exp(std::clamp(update[3], -0.3, 0.3));
    camera.shift += update.segment<2>(4);
    view.b += update.tail(m);
  }
}

// Least squares for the mean and the modes of each pair of points. The equations of the mirrored
// point are those of this point with x reversed.
void Trainer::update_shape() {
  const Index terms = m + 1;
  cv::parallel_for_(cv::Range(0, static_cast<int>(n)), [&](const cv::Range& range) {
    for (int at = range.start; at < range.end; ++at) {
      const Index i = at;
      const Index other = markup.mirror[static_cast<std::size_t>(at)];
      if (other < i) continue;
      MatrixXd normal = MatrixXd::Zero(3 * terms, 3 * terms);
      VectorXd right = VectorXd::Zero(3 * terms);
      for (const View& view : views) {
        VectorXd one(terms);
        one << 1, view.b;
        for (const Index point : {i, other}) {
          Eigen::Matrix<double, 2, 3> rows = view.camera.scale * view.camera.rotation.topRows<2>();
          if (point != i) rows.col(0) *= -1;
          const double w = view.weight[point];
          const Matrix3d square = w * rows.transpose() * rows;
          const Vector3d pull = w * rows.transpose() * (view.flat.col(point) - view.camera.shift);
          for (Index k = 0; k < terms; ++k) {
            right.segment<3>(3 * k) += one[k] * pull;
            for (Index l = 0; l <= k; ++l)
              normal.block<3, 3>(3 * k, 3 * l) += view.moment(k, l) * square;
          }
          if (other == i) break;
        }
      }
      for (Index k = 0; k < terms; ++k) {
        for (Index l = 0; l < k; ++l)
          normal.block<3, 3>(3 * l, 3 * k) = normal.block<3, 3>(3 * k, 3 * l).transpose();
        if (other != i) continue;
        // A point in the plane of symmetry stays in it.
        normal.row(3 * k).setZero();
        normal.col(3 * k).setZero();
        normal(3 * k, 3 * k) = 1;
        right[3 * k] = 0;
      }
      normal.diagonal().array() += 1e-9 * normal.trace() / static_cast<double>(3 * terms);
      const VectorXd solution = linalg::solve_symmetric(normal, right);
      for (Index k = 0; k < terms; ++k) {
        Vector3d value = solution.segment<3>(3 * k);
        for (const Index point : {i, other}) {
          if (k == 0) {
            mean.col(point) = value;
          } else {
            modes.block<3, 1>(3 * point, k - 1) = value;
          }
          value[0] = -value[0];
          if (other == i) break;
        }
      }
    }
  });
}

// Fixes the gauge: b has mean 0 and variance 1; the modes do not move, rotate or scale the head as
// a whole; the origin is midway between the eyes; the eye distance is given.
void Trainer::fix_gauge() {
  if (m > 0) {
    MatrixXd moment = MatrixXd::Zero(m + 1, m + 1);
    for (const View& view : views) moment += view.moment;
    moment /= static_cast<double>(views.size());
    const VectorXd shift = moment.col(0).tail(m);
    const MatrixXd covariance = moment.bottomRightCorner(m, m) - shift * shift.transpose();
    Eigen::Map<VectorXd>(mean.data(), 3 * n) += modes * shift;
    const MatrixXd lower = linalg::Cholesky(covariance).lower();
    modes = modes * lower;
    for (View& view : views) {
      view.b = lower.triangularView<Eigen::Lower>().solve(VectorXd(view.b - shift));
    }
  }
  const Vector3d left = mean.col(markup.outer_eyes[0]);
  const Vector3d right = mean.col(markup.outer_eyes[1]);
  const Vector3d origin = (left + right) / 2;
  mean.colwise() -= origin;
  const double grow = options.outer_eye_mm / (right - left).norm();
  mean *= grow;
  modes *= grow;
  for (View& view : views) {
    ScaledOrthography& camera = view.camera;
    camera.shift += camera.scale * (camera.rotation * origin).head<2>();
    camera.scale /= grow;
  }
  if (m == 0) return;
  MatrixXd whole = MatrixXd::Zero(3 * n, 4);
  const Matrix3Xd centred = mean.colwise() - mean.rowwise().mean();
  for (Index i = 0; i < n; ++i) {
    whole(3 * i + 1, 0) = 1;
    whole(3 * i + 2, 1) = 1;
    whole.block<3, 1>(3 * i, 2) = centred.col(i);
    whole(3 * i + 1, 3) = -centred(2, i);
    whole(3 * i + 2, 3) = centred(1, i);
  }
  const MatrixXd basis = linalg::orthonormal_basis(whole);
  modes -= basis * (basis.transpose() * modes);
}

void Trainer::update_noise() {
  for (Index i = 0; i < n; ++i) {
    double sum = 0;
    double weight = 0;
    for (const View& view : views) {
      for (const Index point :
           {i, static_cast<Index>(markup.mirror[static_cast<std::size_t>(i)])}) {
        sum += view.weight[point] * view.squared[point];
        weight += 2 * view.weight[point];
      }
    }
    // At least a tenth of a percent of the head, so that no point gets an infinite weight.
    noise[i] = std::sqrt(std::max(sum / std::max(weight, 1e-12), 1e-6));
  }
}

HeadModel model_of(const Trainer& trainer) {
  HeadModel model;
  model.mean = trainer.mean;
  // Make both sides exactly symmetric.
  for (Index i = 0; i < trainer.n; ++i) {
    const Index other = trainer.markup.mirror[static_cast<std::size_t>(i)];
    if (other > i) model.mean.col(other) = Vector3d(-1, 1, 1).cwiseProduct(model.mean.col(i));
    if (other == i) model.mean(0, i) = 0;
  }
  model.modes.resize(3 * trainer.n, 0);
  if (trainer.m > 0) {
    const linalg::LeftSvd svd = linalg::left_svd(trainer.modes);
    model.modes = svd.u;
    model.deviation = svd.values;
  }
  model.mirror = trainer.markup.mirror;
  model.outer_eyes = trainer.markup.outer_eyes;
  model.connections = trainer.markup.connections;
  model.landmark.resize(static_cast<std::size_t>(trainer.n));
  std::iota(model.landmark.begin(), model.landmark.end(), 0);
  for (std::size_t i = 0; i < trainer.is_outline.size(); ++i)
    if (trainer.is_outline[i] != 0) model.outline.push_back(static_cast<int>(i));
  model.trained_on = static_cast<int>(trainer.views.size());
  return model;
}

// Rotates the head about x so that the median face has pitch 0.
void set_median_pitch_to_zero(Trainer& trainer) {
  std::vector<double> pitches;
  for (const View& view : trainer.views)
    pitches.push_back(angles_of_rotation(view.camera.rotation).pitch_deg);
  const auto median = pitches.begin() + static_cast<std::ptrdiff_t>(pitches.size() / 2);
  std::nth_element(pitches.begin(), median, pitches.end());
  const Matrix3d rotation = rotation_of_angles({0, *median, 0});
  trainer.mean = rotation * trainer.mean;
  for (Index i = 0; i < trainer.n; ++i)
    trainer.modes.middleRows(3 * i, 3) = rotation * trainer.modes.middleRows(3 * i, 3).eval();
  for (View& view : trainer.views)
    view.camera.rotation = view.camera.rotation * rotation.transpose();
}

}  // namespace

TrainedHead train_head(const std::vector<Matrix2Xd>& faces, const shape::Markup& markup,
                       const TrainHeadOptions& options, Progress* progress, std::stop_token stop) {
  options.check();
  Trainer trainer{options, markup, {}, {}, {}, {}, {}};
  trainer.n = static_cast<Index>(markup.mirror.size());
  const Index n = trainer.n;
  TARSIER_REQUIRE(n >= 4, "a markup of {} points", n);
  for (const int eye : markup.outer_eyes)
    TARSIER_REQUIRE(eye >= 0 && eye < n, "outer eye corner {} of {} points", eye, n);
  TARSIER_REQUIRE(
      markup.mirror[static_cast<std::size_t>(markup.outer_eyes[0])] == markup.outer_eyes[1],
      "the outer eye corners are not a pair");
  for (Index i = 0; i < n; ++i) {
    const int other = markup.mirror[static_cast<std::size_t>(i)];
    TARSIER_REQUIRE(other >= 0 && other < n && markup.mirror[static_cast<std::size_t>(other)] == i,
                    "the mirror of point {} is {}", i, other);
  }
  trainer.is_outline.assign(static_cast<std::size_t>(n), 0);
  std::vector<int> outline = options.outline;
  if (outline.empty() && n == 68) {
    outline.resize(17);
    std::iota(outline.begin(), outline.end(), 0);
  }
  for (const int i : outline) {
    TARSIER_REQUIRE(i >= 0 && i < n, "outline point {} of {}", i, n);
    trainer.is_outline[static_cast<std::size_t>(i)] = 1;
  }
  std::vector<std::size_t> used;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    TARSIER_REQUIRE(faces[f].cols() == n, "face {} has {} points, the markup {}", f,
                    faces[f].cols(), n);
    if (!faces[f].allFinite()) continue;
    const Matrix2Xd centred = faces[f].colwise() - faces[f].rowwise().mean();
    const double size = std::sqrt(centred.squaredNorm() / static_cast<double>(n));
    if (!(size > 0)) continue;
    View view;
    view.points = centred / size;
    view.moment = MatrixXd::Ones(1, 1);
    view.flat = view.points;
    view.visible = view.weight = VectorXd::Ones(n);
    view.squared = VectorXd::Zero(n);
    trainer.views.push_back(std::move(view));
    used.push_back(f);
  }
  TARSIER_REQUIRE(used.size() >= 10, "{} complete faces", used.size());

  trainer.start();
  // The rigid head first; modes are added when the poses are approximately known.
  const int rigid_iterations = std::min(10, options.iterations / 2);
  if (progress != nullptr) progress->begin("head", options.iterations, "iterations");
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    throw_if_stopped(stop);
    if (iteration == rigid_iterations && options.modes > 0) {
      trainer.m = options.modes;
      trainer.modes.resize(3 * n, trainer.m);
      Rng rng(options.seed);
      for (Index k = 0; k < trainer.m; ++k) {
        for (Index i = 0; i < n; ++i) {
          const Index other = markup.mirror[static_cast<std::size_t>(i)];
          for (Index c = 0; c < 3; ++c) {
            const double value = rng.normal();
            if (other < i) continue;
            trainer.modes(3 * i + c, k) = value;
            trainer.modes(3 * other + c, k) = c == 0 ? -value : value;
            if (other == i && c == 0) trainer.modes(3 * i, k) = 0;
          }
        }
      }
      for (View& view : trainer.views) view.b = VectorXd::Zero(trainer.m);
    }
    cv::parallel_for_(cv::Range(0, static_cast<int>(trainer.views.size())),
                      [&](const cv::Range& range) {
                        for (int f = range.start; f < range.end; ++f) {
                          View& view = trainer.views[static_cast<std::size_t>(f)];
                          trainer.update_visibility(view);
                          trainer.estimate(view, 2);
                        }
                      });
    trainer.update_noise();
    trainer.update_shape();
    trainer.fix_gauge();
    if (progress != nullptr) progress->advance();
  }
  set_median_pitch_to_zero(trainer);
  if (progress != nullptr) progress->end();

  TrainedHead result;
  result.model = model_of(trainer);
  result.angles.resize(faces.size());
  double sum = 0;
  double weight = 0;
  double scale = 0;
  for (std::size_t f = 0; f < used.size(); ++f) {
    const View& view = trainer.views[f];
    result.angles[used[f]] = angles_of_rotation(view.camera.rotation);
    scale += view.camera.scale / static_cast<double>(used.size());
    sum += view.weight.dot(view.squared) / (view.camera.scale * view.camera.scale);
    weight += 2 * view.weight.sum();
  }
  result.model.noise = trainer.noise / scale;
  result.model.check();
  result.rms_mm = std::sqrt(sum / weight);
  return result;
}

double aligned_error(const Matrix3Xd& shape, const Matrix3Xd& truth,
                     const std::vector<int>& points) {
  TARSIER_REQUIRE(shape.cols() == truth.cols() && shape.cols() >= 3, "shapes of {} and {} points",
                  shape.cols(), truth.cols());
  const auto truth_from_shape = geometry::similarity_between(shape, truth);
  TARSIER_REQUIRE(truth_from_shape, "points on a line");
  std::vector<int> all = points;
  if (all.empty()) {
    all.resize(static_cast<std::size_t>(shape.cols()));
    std::iota(all.begin(), all.end(), 0);
  }
  double sum = 0;
  for (const int i : all) {
    TARSIER_REQUIRE(i >= 0 && i < shape.cols(), "point {} of {}", i, shape.cols());
    sum += (*truth_from_shape * shape.col(i) - truth.col(i)).norm();
  }
  return sum / static_cast<double>(all.size());
}

}  // namespace tarsier::face::head
