// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/fit_level.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::appearance {

using Eigen::Index;
using Eigen::MatrixXf;
using Eigen::VectorXf;

namespace {

constexpr double kHuberThreshold =
    1.345;  // residuals up to this number of deviations have full weight

// Sum and sum of squares, accumulated in parts that single precision can represent.
struct Sums {
  double sum = 0;
  double square = 0;
};
Sums sums_of(const float* values, Index count) {
  Sums result;
  constexpr Index kBlock = 512;
  for (Index first = 0; first < count; first += kBlock) {
    const Eigen::Map<const VectorXf> block(values + first, std::min(kBlock, count - first));
    result.sum += static_cast<double>(block.sum());
    result.square += static_cast<double>(block.squaredNorm());
  }
  return result;
}

}  // namespace

void sample_texture(const FitLevel& level, FitWorkspace& w, LevelState& state) {
  const Texture& texture = *level.texture;
  const Index n = texture.size();
  const auto count = static_cast<double>(n);
  const Index points = level.model->points();
  w.all_points.resize(2, points + static_cast<Index>(level.model->outer.size()));
  w.all_points.leftCols(points) = w.points;
  if (!level.model->outer.empty()) {
    const Eigen::Vector2d center = w.points.rowwise().mean();
    Index at = points;
    for (const int i : level.model->outer)
      w.all_points.col(at++) = w.points.col(i) + level.model->margin * (w.points.col(i) - center);
  }
  level.sampler.maps(w.all_points, w.maps);
  w.sampled.resize(n);
  level.sampler.sample(w.upright.values, w.maps, w.sampled.data());
  w.mode_coefficients.resize(level.modes.cols());

  const bool with_offset = has_offset(texture.channels);
  state.inside = 1;
  Sums sums;
  double used = count;
  const bool is_partial = !w.upright.inside.empty();
  if (!is_partial) {
    sums = sums_of(w.sampled.data(), n);
  } else {
    const int in_image = level.sampler.look_up(w.upright.inside, w.maps, w.inside);
    state.inside = in_image / static_cast<double>(level.sampler.pixels());
    used = std::max(1.0, in_image * static_cast<double>(level.channels));
    const float* value = w.sampled.data();
    for (const std::uint8_t in : w.inside) {
      for (int c = 0; c < level.channels; ++c, ++value) {
        if (in == 0) continue;
        sums.sum += static_cast<double>(*value);
        sums.square += static_cast<double>(*value) * static_cast<double>(*value);
      }
    }
  }
  state.offset = with_offset ? sums.sum / used : 0;
  const double variance = sums.square / used - state.offset * state.offset;
  const double rms = std::sqrt(std::max(0.0, variance));
  const double factor = rms > 1e-9 ? level.unit / rms : 0;
  w.sampled.array() =
      (w.sampled.array() - static_cast<float>(state.offset)) * static_cast<float>(factor);
  if (is_partial) {
    // Pixels outside the image are set to the mean texture, so that they have no effect.
    double projection = 0;
    double square = 0;
    const float* mean = texture.mean.data();
    float* value = w.sampled.data();
    std::size_t k = 0;
    for (Index i = 0; i < n; ++i) {
      k = static_cast<std::size_t>(i / level.channels);
      if (w.inside[k] == 0) continue;
      projection += static_cast<double>(mean[i]) * static_cast<double>(value[i]);
      square += static_cast<double>(mean[i]) * static_cast<double>(mean[i]);
    }
    const auto gain = static_cast<float>(square > 0 ? projection / square : 0);
    for (Index i = 0; i < n; ++i) {
      k = static_cast<std::size_t>(i / level.channels);
      if (w.inside[k] == 0) value[i] = gain * mean[i];
    }
  }
  w.mode_coefficients.noalias() = level.modes.transpose() * w.sampled;
  const double square =
      is_partial ? static_cast<double>(w.sampled.squaredNorm()) : count * level.unit * level.unit;
  state.error =
      factor > 0 && square > 0
          ? std::sqrt(
                std::max(0.0, square - static_cast<double>(w.mode_coefficients.squaredNorm())) /
                square)
          : 1;
  // In units of the image: sampled = factor (image - offset).
  state.gain =
      factor > 0 ? static_cast<double>(w.mode_coefficients[0]) / std::sqrt(count) / factor : 0;
}

void solve_project_out(const FitLevel& level, FitWorkspace& w) {
  w.products.resize(level.parameters);
  w.products.noalias() = level.descent.transpose() * w.sampled;
  w.right.resize(level.parameters);
  w.right = w.products.cast<double>();
  w.right.tail(level.parameters - 4).array() +=
      level.shape_prior.tail(level.parameters - 4).array() * w.p.head(level.parameters - 4).array();
  w.step.resize(level.parameters);
  w.step.noalias() = level.inverse_hessian * w.right;
}

void init_texture(const FitLevel& level, FitWorkspace& w, bool from_mean) {
  w.c = w.mode_coefficients.cwiseProduct(level.mode_weights);
  if (!from_mean) return;
  w.c.setZero();
  w.c[0] = std::sqrt(static_cast<float>(level.texture->size()));
}

const FitTemplate& template_of(const FitLevel& level, const FitOptions& options, FitWorkspace& w) {
  const auto index = static_cast<std::size_t>(level.index);
  if (w.templates.size() <= index) w.templates.resize(index + 1);
  FitTemplate& fit_template = w.templates[index];
  if (fit_template.level == &level && fit_template.c.size() == w.c.size()) {
    const float change = (w.c - fit_template.c).squaredNorm();
    const auto max_change = static_cast<float>(options.refresh * options.refresh);
    if (change <= max_change * fit_template.c.squaredNorm() && options.refresh > 0)
      return fit_template;
  }
  fit_template.level = &level;
  fit_template.c = w.c;
  w.target.resize(level.texture->size());
  w.target.noalias() = level.modes * w.c;
  steepest_descent(level, w.target.data(), fit_template.descent);
  if (has_offset(level.texture->channels)) {
    for (Index k = 0; k < fit_template.descent.cols(); ++k)
      fit_template.descent.col(k).array() -= fit_template.descent.col(k).mean();
  }
  fit_template.overlap.resize(level.modes.cols(), level.parameters);
  fit_template.overlap.noalias() = level.modes.transpose() * fit_template.descent;
  if (options.robust) {
    w.scaled_overlap = level.mode_weights.asDiagonal() * fit_template.overlap;
    fit_template.projected = fit_template.descent;
    fit_template.projected.noalias() -= level.modes * w.scaled_overlap;
    return fit_template;
  }
  w.normal.setZero(level.parameters, level.parameters);
  w.normal.selfadjointView<Eigen::Lower>().rankUpdate(fit_template.descent.transpose());
  w.scaled_overlap = level.mode_weights.cwiseSqrt().asDiagonal() * fit_template.overlap;
  w.normal.selfadjointView<Eigen::Lower>().rankUpdate(w.scaled_overlap.transpose(), -1.0F);
  w.hessian = w.normal.cast<double>();
  w.hessian.diagonal().array() += 1e-6 * w.hessian.diagonal().maxCoeff() + 1e-12;
  w.hessian.diagonal() += level.shape_prior;
  fit_template.solver.compute(w.hessian);
  return fit_template;
}

void solve_alternating(const FitLevel& level, const FitOptions& options, FitWorkspace& w) {
  const Texture& texture = *level.texture;
  const Index m = texture.mode_count();
  const auto root = std::sqrt(static_cast<float>(texture.size()));
  // Limit the coefficient of the mean, which is the gain.
  w.c[0] = std::clamp(w.c[0], 0.3F * root, 2 * root);
  const float gain = w.c[0] / root;
  for (Index k = 0; k < m; ++k) {
    const float max_c = static_cast<float>(3 * texture.deviation[k]) * gain;
    w.c[1 + k] = std::clamp(w.c[1 + k], -max_c, max_c);
  }
  const FitTemplate& fit_template = template_of(level, options, w);
  if (options.robust) {
    solve_robust(level, w, fit_template.projected);
  } else {
    w.products.resize(level.parameters);
    w.products.noalias() = fit_template.descent.transpose() * w.sampled;
    w.products.noalias() -=
        fit_template.overlap.transpose() * level.mode_weights.cwiseProduct(w.mode_coefficients);
    w.right = w.products.cast<double>();
    w.right.tail(level.parameters - 4).array() +=
        level.shape_prior.tail(level.parameters - 4).array() *
        w.p.head(level.parameters - 4).array();
    w.step = fit_template.solver.solve(w.right);
  }
  // The texture parameters after the step of the warp.
  w.c = w.mode_coefficients - fit_template.overlap * w.step.cast<float>();
  w.c = w.c.cwiseProduct(level.mode_weights);
}

void solve_robust(const FitLevel& level, FitWorkspace& w, const MatrixXf& descent) {
  const int channels = level.channels;
  const auto pixels = static_cast<Index>(level.neighbours.size());
  w.residual = w.sampled;
  w.residual.noalias() -= level.modes * w.mode_coefficients;
  w.buffer.resize(static_cast<std::size_t>(pixels));
  w.weights.resize(pixels);
  for (Index i = 0; i < pixels; ++i) {
    float square = 0;
    for (int c = 0; c < channels; ++c) {
      const float r = w.residual[i * channels + c];
      square += r * r;
    }
    w.weights[i] = std::sqrt(square);
    w.buffer[static_cast<std::size_t>(i)] = w.weights[i];
  }
  auto median = w.buffer.begin() + static_cast<std::ptrdiff_t>(w.buffer.size() / 2);
  std::nth_element(w.buffer.begin(), median, w.buffer.end());
  const float limit = static_cast<float>(kHuberThreshold * 1.4826) * *median + 1e-12F;
  for (Index i = 0; i < pixels; ++i)
    w.weights[i] = w.weights[i] <= limit ? 1 : limit / w.weights[i];
  // sqrt(w) J and sqrt(w) e.
  w.descent.resize(descent.rows(), descent.cols());
  for (Index k = 0; k < descent.cols(); ++k) {
    for (Index i = 0; i < pixels; ++i) {
      const float root = std::sqrt(w.weights[i]);
      for (int c = 0; c < channels; ++c)
        w.descent(i * channels + c, k) = root * descent(i * channels + c, k);
    }
  }
  for (Index i = 0; i < pixels; ++i) {
    const float root = std::sqrt(w.weights[i]);
    for (int c = 0; c < channels; ++c) w.residual[i * channels + c] *= root;
  }
  w.normal.setZero(level.parameters, level.parameters);
  w.normal.selfadjointView<Eigen::Lower>().rankUpdate(w.descent.transpose());
  w.hessian = w.normal.cast<double>();
  w.hessian.diagonal().array() += 1e-6 * w.hessian.diagonal().maxCoeff() + 1e-12;
  w.hessian.diagonal() += level.shape_prior;
  w.products.resize(level.parameters);
  w.products.noalias() = w.descent.transpose() * w.residual;
  w.right = w.products.cast<double>();
  w.right.tail(level.parameters - 4).array() +=
      level.shape_prior.tail(level.parameters - 4).array() * w.p.head(level.parameters - 4).array();
  w.solver.compute(w.hessian);
  w.step = w.solver.solve(w.right);
}

void set_points(const FitLevel& level, double a, double b, const Eigen::Vector2d& center,
                FitWorkspace& w) {
  const Index n = level.mean.cols();
  w.points.resize(2, n);
  const Index modes = level.parameters - 4;
  for (Index i = 0; i < n; ++i) {
    double x = level.mean(0, i);
    double y = level.mean(1, i);
    for (Index k = 0; k < modes; ++k) {
      x += level.basis(2 * i, 4 + k) * w.p[k];
      y += level.basis(2 * i + 1, 4 + k) * w.p[k];
    }
    w.points(0, i) = a * x - b * y + center.x();
    w.points(1, i) = b * x + a * y + center.y();
  }
}

bool update_warp(const FitLevel& level, const FitOptions& options, FitWorkspace& w) {
  if (!w.step.allFinite()) return false;
  const Index n = level.mean.cols();
  // To first order, the inverse of a small step is the negative step (their eq. 33).
  w.frame_step.resize(2, n);
  Eigen::Map<Eigen::VectorXd>(w.frame_step.data(), 2 * n).noalias() = -level.basis * w.step;
  w.last_points = w.points;
  level.sampler.compose(w.maps, w.frame_step, w.points);
  if (!w.points.allFinite()) return false;
  // q, then p: at the mean, the similarity's directions are orthogonal to the modes.
  const Eigen::Vector2d center = w.points.rowwise().mean();
  double a = 0;
  double b = 0;
  for (Index i = 0; i < n; ++i) {
    const double x = w.points(0, i) - center.x();
    const double y = w.points(1, i) - center.y();
    a += level.mean(0, i) * x + level.mean(1, i) * y;
    b += level.mean(0, i) * y - level.mean(1, i) * x;
  }
  a /= level.mean_square;
  b /= level.mean_square;
  const double square = a * a + b * b;
  if (!(square > 0.05 && square < 10)) return false;
  const double ia = a / square;
  const double ib = -b / square;
  for (Index i = 0; i < n; ++i) {
    const double x = w.points(0, i) - center.x();
    const double y = w.points(1, i) - center.y();
    w.frame_step(0, i) = ia * x - ib * y - level.mean(0, i);
    w.frame_step(1, i) = ib * x + ia * y - level.mean(1, i);
  }
  const Index modes = level.parameters - 4;
  w.p.head(modes).noalias() = level.basis.rightCols(modes).transpose() *
                              Eigen::Map<const Eigen::VectorXd>(w.frame_step.data(), 2 * n);
  for (Index k = 0; k < modes; ++k) {
    const double max_p =
        options.sigmas * level.model->shape.deviation[k] * level.texture->px_per_unit;
    w.p[k] = std::clamp(w.p[k], -max_p, max_p);
  }
  set_points(level, a, b, center, w);
  return true;
}

}  // namespace tarsier::face::appearance
