// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/shape_model.h"

#include "tarsier/core/require.h"
#include "tarsier/face/shape/markup_check.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::shape {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kUnitTolerance = 1e-6;  // tolerance for a model's radius and orthonormality

Eigen::Map<const VectorXd> flat(const Matrix2Xd& points) { return {points.data(), points.size()}; }

// Each point rotated by 90 degrees: (x, y) -> (-y, x).
Matrix2Xd quarter_turn(const Matrix2Xd& points) {
  Matrix2Xd result(2, points.cols());
  result.row(0) = -points.row(1);
  result.row(1) = points.row(0);
  return result;
}

double rms_radius(const Matrix2Xd& points) {
  return std::sqrt(points.squaredNorm() / static_cast<double>(points.cols()));
}

// Centred, RMS radius 1.
Matrix2Xd normalised(const Matrix2Xd& points) {
  const Matrix2Xd centred = points.colwise() - points.rowwise().mean().eval();
  const double radius = rms_radius(centred);
  const double size = points.cwiseAbs().maxCoeff();
  TARSIER_REQUIRE(radius > 1e-12 * size && std::isfinite(radius), "shapes of extent {}", radius);
  return centred / radius;
}

// 2n x 4, orthonormal: scale, rotation, shift along x and y of a centred mean.
MatrixXd similarity_directions(const Matrix2Xd& mean) {
  const Index n = mean.cols();
  MatrixXd directions = MatrixXd::Zero(2 * n, 4);
  const double radius = mean.norm();
  directions.col(0) = flat(mean) / radius;
  directions.col(1) = flat(quarter_turn(mean)) / radius;
  const double step = 1 / std::sqrt(static_cast<double>(n));
  for (Index i = 0; i < n; ++i) {
    directions(2 * i, 2) = step;
    directions(2 * i + 1, 3) = step;
  }
  return directions;
}

// The shape aligned to the mean, in the tangent plane there (its projection on the mean is the
// mean), so that T(mean + modes b) holds exactly. This would scale up shapes that differ from the
// mean by more than 60 degrees without bound, so they get less weight.
Matrix2Xd aligned_to(const Matrix2Xd& mean, const Matrix2Xd& shape) {
  constexpr double kMinCosine2 = 0.25;
  const Similarity2d image_from_mean = fit_similarity(mean, shape);
  const double scale = image_from_mean.scale();
  const double extent2 = (shape.colwise() - shape.rowwise().mean().eval()).squaredNorm();
  const double cosine2 = scale * scale * mean.squaredNorm() / extent2;
  if (cosine2 < 1e-20) return Matrix2Xd::Zero(2, mean.cols());
  return image_from_mean.inverse()(shape) * std::min(1.0, cosine2 / kMinCosine2);
}

Matrix2Xd procrustes_mean(const std::vector<Matrix2Xd>& shapes, int iterations) {
  Matrix2Xd mean = normalised(shapes.front());
  for (int k = 0; k < iterations; ++k) {
    Matrix2Xd sum = Matrix2Xd::Zero(2, mean.cols());
    for (const Matrix2Xd& shape : shapes) sum += aligned_to(mean, shape);
    sum = normalised(sum / static_cast<double>(shapes.size()));
    const double change = rms_radius(sum - mean);
    mean = std::move(sum);
    if (change < 1e-12) break;
  }
  // Upright: the rotations of the shapes relative to it cancel.
  double a = 0;
  double b = 0;
  for (const Matrix2Xd& shape : shapes) {
    const Similarity2d fit = fit_similarity(mean, shape);
    const double scale = fit.scale();
    if (scale > 0) {
      a += fit.a / scale;
      b += fit.b / scale;
    }
  }
  const double length = std::hypot(a, b);
  if (length < 1e-6 * static_cast<double>(shapes.size())) return mean;
  return Similarity2d{a / length, b / length, 0, 0}(mean);
}

struct Spectrum {
  VectorXd variances;  // falling
  MatrixXd modes;      // 2n x as many
  double total = 0;
};

// PCA of residuals (columns) about 0.
Spectrum principal_components(const MatrixXd& residuals, double count) {
  Spectrum spectrum;
  const bool is_wide = residuals.cols() >= residuals.rows();
  const MatrixXd moments = (is_wide ? (residuals * residuals.transpose()).eval()
                                    : (residuals.transpose() * residuals).eval()) /
                           std::max(1.0, count - 1);
  spectrum.total = moments.trace();
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(moments);
  spectrum.variances = eigen.values.reverse().cwiseMax(0);
  spectrum.modes = eigen.vectors.rowwise().reverse();
  if (!is_wide) spectrum.modes = (residuals * spectrum.modes).eval();
  return spectrum;
}

void set_modes(ShapeModel& model, const Spectrum& spectrum, const MatrixXd& directions,
               const ShapeModelOptions& options) {
  // For equal shapes, only rounding errors remain.
  const double min_variance =
      std::max(1e-20 * static_cast<double>(model.mean.size()), 1e-13 * spectrum.total);
  const auto max_count = std::min<Index>(
      {options.max_modes, spectrum.variances.size(), std::max<Index>(0, model.mean.size() - 4)});
  Index count = 0;
  double kept = 0;
  while (count < max_count && spectrum.variances[count] > min_variance &&
         kept < options.variance * spectrum.total) {
    kept += spectrum.variances[count++];
  }
  model.modes.resize(model.mean.size(), count);
  model.deviation = spectrum.variances.head(count).cwiseSqrt();
  model.variance_kept = spectrum.total > min_variance ? std::min(1.0, kept / spectrum.total) : 1.0;
  for (Index k = 0; k < count; ++k) {
    VectorXd mode = spectrum.modes.col(k).normalized();
    for (int pass = 0; pass < 2; ++pass) {
      mode -= directions * (directions.transpose() * mode).eval();
      mode -= model.modes.leftCols(k) * (model.modes.leftCols(k).transpose() * mode).eval();
      mode.normalize();
    }
    Index largest = 0;
    mode.cwiseAbs().maxCoeff(&largest);
    // The same sign on all machines.
    model.modes.col(k) = mode[largest] < 0 ? VectorXd(-mode) : mode;
  }
}

}  // namespace

void ShapeModel::check() const {
  const Index n = mean.cols();
  TARSIER_REQUIRE(n >= 2 && n <= kMaxPoints, "{} points", n);
  TARSIER_REQUIRE(mean.allFinite(), "the mean is not finite");
  TARSIER_REQUIRE(mean.rowwise().mean().norm() < kUnitTolerance, "the mean is not centred");
  TARSIER_REQUIRE(std::abs(rms_radius(mean) - 1) < kUnitTolerance, "the mean has RMS radius {}",
                  rms_radius(mean));
  const Index m = modes.cols();
  TARSIER_REQUIRE(modes.rows() == 2 * n || m == 0, "modes of {} numbers for {} points",
                  modes.rows(), n);
  TARSIER_REQUIRE(m <= std::max<Index>(0, 2 * n - 4), "{} modes of {} points", m, n);
  TARSIER_REQUIRE(deviation.size() == m, "{} deviations of {} modes", deviation.size(), m);
  TARSIER_REQUIRE(modes.allFinite(), "the modes are not finite");
  if (m > 0) {
    const MatrixXd basis = combined_basis(*this);
    const MatrixXd gram = basis.transpose() * basis;
    TARSIER_REQUIRE(
        (gram - MatrixXd::Identity(4 + m, 4 + m)).cwiseAbs().maxCoeff() < kUnitTolerance,
        "the modes are not orthonormal");
  }
  for (Index k = 0; k < m; ++k) {
    TARSIER_REQUIRE(deviation[k] >= 0 && std::isfinite(deviation[k]), "deviation {} of mode {}",
                    deviation[k], k);
    TARSIER_REQUIRE(k == 0 || deviation[k] <= deviation[k - 1], "deviations that rise at mode {}",
                    k);
  }
  TARSIER_REQUIRE(variance_kept >= 0 && variance_kept <= 1, "variance_kept {}", variance_kept);
  TARSIER_REQUIRE(trained_on >= 0, "trained_on {}", trained_on);
  check_mirror(mirror, points());
  check_connections(connections, points());
}

ShapeModel train_shape_model(const std::vector<Matrix2Xd>& shapes,
                             const ShapeModelOptions& options) {
  options.check();
  std::vector<Matrix2Xd> complete;
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    TARSIER_REQUIRE(shapes[k].cols() == shapes[0].cols(), "shape {} has {} points, the first {}", k,
                    shapes[k].cols(), shapes[0].cols());
    TARSIER_REQUIRE(!shapes[k].array().isInf().any(), "shape {} is not finite", k);
    if (!shapes[k].hasNaN() && shapes[k].cols() > 0) complete.push_back(normalised(shapes[k]));
  }
  TARSIER_REQUIRE(complete.size() >= 2, "{} complete shapes; two are needed", complete.size());
  TARSIER_REQUIRE(complete[0].cols() >= 2 && complete[0].cols() <= kMaxPoints,
                  "shapes of {} points", complete[0].cols());

  ShapeModel model;
  model.mean = procrustes_mean(complete, options.iterations);
  model.trained_on = static_cast<int>(complete.size());
  const MatrixXd directions = similarity_directions(model.mean);
  MatrixXd residuals(model.mean.size(), static_cast<Index>(complete.size()));
  for (std::size_t k = 0; k < complete.size(); ++k)
    residuals.col(static_cast<Index>(k)) = flat(aligned_to(model.mean, complete[k]) - model.mean);
  residuals -= directions * (directions.transpose() * residuals).eval();
  set_modes(model, principal_components(residuals, static_cast<double>(complete.size())),
            directions, options);
  return model;
}

ShapeModel train_shape_model(const LandmarkSet& set, const ShapeModelOptions& options) {
  options.check();
  set.check();
  TARSIER_REQUIRE(!options.mirror || !set.mirror.empty(), "the set has no symmetry");
  std::vector<Matrix2Xd> shapes;
  for (const LandmarkSample& sample : set.samples) {
    shapes.push_back(sample.points);
    if (options.mirror) shapes.push_back(mirrored(sample, set.mirror, 1).points);
  }
  ShapeModel model = train_shape_model(shapes, options);
  model.mirror = set.mirror;
  model.connections = set.connections;
  return model;
}

bool clamp(const ShapeModel& model, VectorXd& b, double sigmas) {
  TARSIER_REQUIRE(b.size() == model.modes.cols(), "{} parameters of {} modes", b.size(),
                  model.modes.cols());
  TARSIER_REQUIRE(sigmas >= 0, "sigmas {}", sigmas);
  bool was_out = false;
  for (Index k = 0; k < b.size(); ++k) {
    const double limit = sigmas * model.deviation[k];
    if (std::abs(b[k]) <= limit) continue;
    b[k] = std::copysign(limit, b[k]);
    was_out = true;
  }
  return was_out;
}

Matrix2Xd shape_of(const ShapeModel& model, const VectorXd& b) {
  TARSIER_REQUIRE(b.size() == model.modes.cols(), "{} parameters of {} modes", b.size(),
                  model.modes.cols());
  Matrix2Xd result = model.mean;
  if (b.size() > 0) Eigen::Map<VectorXd>(result.data(), result.size()).noalias() += model.modes * b;
  return result;
}

Matrix2Xd shape_of(const ShapeModel& model, const ShapeFit& fit) {
  return fit.image_from_model(shape_of(model, fit.b));
}

MatrixXd combined_basis(const ShapeModel& model) {
  MatrixXd basis(model.mean.size(), 4 + model.modes.cols());
  basis.leftCols(4) = similarity_directions(model.mean);
  if (model.modes.cols() > 0) basis.rightCols(model.modes.cols()) = model.modes;
  return basis;
}

}  // namespace tarsier::face::shape
