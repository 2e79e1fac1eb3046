// SPDX-License-Identifier: MIT
#include "tarsier/marker/align.h"

#include "tarsier/core/require.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace tarsier::marker {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kParameters = 14;  // 8 of the homography, 2 of blur, 4 of light
using Row = Eigen::Matrix<double, kParameters, 1>;
using Normal = Eigen::Matrix<double, kParameters, kParameters>;
// One row a sample: its derivatives, then its error; single precision is enough for a step.
using Rows = Eigen::Matrix<float, kParameters + 1, Eigen::Dynamic>;

// Places along one side, in cells from the marker's corner, and how much of each column of cells a
// blurred pixel there sees: weight(i, k) of column k - 1, with its first two derivatives.
struct Axis {
  VectorXd at;
  MatrixXd weight;
  MatrixXd slope;
  MatrixXd bend;

  Axis(int samples, int columns, double margin) {
    at.resize(samples);
    const double length = columns + 2 * margin;
    for (int i = 0; i < samples; ++i) at[i] = -margin + length * (i + 0.5) / samples;
    weight.resize(samples, columns + 2);
    slope.resize(samples, columns + 2);
    bend.resize(samples, columns + 2);
  }
  void blur(double sigma) {
    const auto columns = weight.cols();
    for (Eigen::Index i = 0; i < at.size(); ++i) {
      // The step at k, k = 0 .. columns - 2, seen from at[i]; paper goes on without end.
      double before = 0;
      double before_slope = 0;
      double before_bend = 0;
      for (Eigen::Index k = 0; k < columns; ++k) {
        double step = 1;
        double step_slope = 0;
        double step_bend = 0;
        if (k + 1 < columns) {
          const double z = (static_cast<double>(k) - at[i]) / sigma;
          if (std::abs(z) > 4.5) {
            step = z > 0 ? 1 : 0;
          } else {
            step = 0.5 * std::erfc(-z / std::numbers::sqrt2);
            // d/du of Phi((k - u) / s) = -phi / s, and again
            const double phi = std::exp(-0.5 * z * z) / (sigma * std::sqrt(2 * std::numbers::pi));
            step_slope = -phi;
            step_bend = -phi * z / sigma;
          }
        }
        weight(i, k) = step - before;
        slope(i, k) = step_slope - before_slope;
        bend(i, k) = step_bend - before_bend;
        before = step;
        before_slope = step_slope;
        before_bend = step_bend;
      }
    }
  }
};

// The marker and a ring of paper: 1 white, -1 black.
MatrixXd pattern_of(Code seen, int cells) {
  MatrixXd pattern = MatrixXd::Ones(cells + 4, cells + 4);
  pattern.block(1, 1, cells + 2, cells + 2).setConstant(-1);
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      const int bit = cells * cells - 1 - (row * cells + column);
      pattern(row + 2, column + 2) = (seen >> static_cast<unsigned>(bit)) & 1U ? 1 : -1;
    }
  }
  return pattern;
}

struct Template {
  MatrixXd value;  // (v, u)
  MatrixXd du;
  MatrixXd dv;
  MatrixXd duu;
  MatrixXd dvv;
};

Template template_of(const MatrixXd& pattern, const Axis& u, const Axis& v) {
  const MatrixXd across = pattern * u.weight.transpose();
  Template t;
  t.value = v.weight * across;
  t.du = v.weight * (pattern * u.slope.transpose());
  t.dv = v.slope * across;
  t.duu = v.weight * (pattern * u.bend.transpose());
  t.dvv = v.bend * across;
  return t;
}

// The picture at the template's places; false where one lies outside.
bool sample(const cv::Mat& gray, const Eigen::Matrix3d& map, const Axis& u, const Axis& v,
            MatrixXd& values) {
  values.resize(v.at.size(), u.at.size());
  for (Eigen::Index i = 0; i < u.at.size(); ++i) {
    for (Eigen::Index j = 0; j < v.at.size(); ++j) {
      const Eigen::Vector3d p = map * Eigen::Vector3d(u.at[i], v.at[j], 1);
      const double x = p.x() / p.z();
      const double y = p.y() / p.z();
      if (!(p.z() > 0 && x >= 0 && y >= 0 && x < gray.cols - 1.001 && y < gray.rows - 1.001))
        return false;
      const int x0 = static_cast<int>(x);
      const int y0 = static_cast<int>(y);
      const double fx = x - x0;
      const double fy = y - y0;
      const auto* a = gray.ptr<std::uint8_t>(y0) + x0;
      const auto* b = gray.ptr<std::uint8_t>(y0 + 1) + x0;
      values(j, i) = (1 - fy) * (a[0] + fx * (a[1] - a[0])) + fy * (b[0] + fx * (b[1] - b[0]));
    }
  }
  return true;
}

// Least squares of values = a T + b + c u + d v with weights.
Eigen::Vector4d fit_light(const MatrixXd& values, const Template& t, const Axis& u, const Axis& v) {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  for (Eigen::Index i = 0; i < u.at.size(); ++i) {
    for (Eigen::Index j = 0; j < v.at.size(); ++j) {
      const Eigen::Vector4d row(t.value(j, i), 1, u.at[i], v.at[j]);
      normal += row * row.transpose();
      right += values(j, i) * row;
    }
  }
  return normal.ldlt().solve(right);
}

double correlation_inside(const MatrixXd& values, const Template& t, const Axis& u, const Axis& v,
                          const Eigen::Vector4d& light, int cells) {
  double n = 0;
  double x = 0;
  double y = 0;
  double xx = 0;
  double yy = 0;
  double xy = 0;
  for (Eigen::Index i = 0; i < u.at.size(); ++i) {
    if (u.at[i] < 1 || u.at[i] > cells + 1) continue;
    for (Eigen::Index j = 0; j < v.at.size(); ++j) {
      if (v.at[j] < 1 || v.at[j] > cells + 1) continue;
      const double a = t.value(j, i);
      const double b = values(j, i) - light[2] * u.at[i] - light[3] * v.at[j];
      n += 1;
      x += a;
      y += b;
      xx += a * a;
      yy += b * b;
      xy += a * b;
    }
  }
  const double spread = (xx - x * x / n) * (yy - y * y / n);
  return spread > 0 ? (xy - x * y / n) / std::sqrt(spread) : 0;
}

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void AlignOptions::check() const {
  TARSIER_REQUIRE(iterations >= 1 && iterations <= 100, "{} iterations", iterations);
  TARSIER_REQUIRE(max_samples >= 8 && max_samples <= 200, "{} samples", max_samples);
  TARSIER_REQUIRE(margin >= 0 && margin <= 1, "a margin of {} cells", margin);
}

std::optional<Alignment> align_marker(const cv::Mat& gray, Code seen, int cells, const Quad& start,
                                      const AlignOptions& options) {
  options.check();
  TARSIER_REQUIRE(gray.type() == CV_8UC1, "a picture that is not grey");
  const int n = cells + 2;
  const auto mean_side = [&](std::size_t k) {
    return 0.5 * ((start[(k + 1) % 4] - start[k]).norm() +
                  (start[(k + 2) % 4] - start[(k + 3) % 4]).norm());
  };
  const double cell_u = mean_side(0) / n;  // px
  const double cell_v = mean_side(1) / n;
  const auto samples = [&](double cell) {
    return std::clamp(static_cast<int>((n + 2 * options.margin) * cell), 2 * n,
                      std::max(2 * n, options.max_samples));
  };
  Axis u(samples(cell_u), n, options.margin);
  Axis v(samples(cell_v), n, options.margin);
  const MatrixXd pattern = pattern_of(seen, cells);
  double blur_u = 0.8 / cell_u;  // cells
  double blur_v = 0.8 / cell_v;
  Eigen::Matrix3d map = picture_from_cells(start, cells);
  MatrixXd values;
  if (!sample(gray, map, u, v, values)) return std::nullopt;
  u.blur(blur_u);
  v.blur(blur_v);
  Template t = template_of(pattern, u, v);
  Eigen::Vector4d light = fit_light(values, t, u, v);
  const double middle = 0.5 * n;
  Rows rows(kParameters + 1, values.size());
  std::vector<double> sizes(static_cast<std::size_t>(values.size()));
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    // How far most values are off: what is much farther (fingers, glare) does not count.
    std::size_t count = 0;
    for (Eigen::Index i = 0; i < u.at.size(); ++i)
      for (Eigen::Index j = 0; j < v.at.size(); ++j)
        sizes[count++] = std::abs(values(j, i) - light[0] * t.value(j, i) - light[1] -
                                  light[2] * u.at[i] - light[3] * v.at[j]);
    const double limit = 4.685 * std::max(1.0, 1.4826 * median_of(sizes)) * 1.5;
    Eigen::Index used = 0;
    for (Eigen::Index i = 0; i < u.at.size(); ++i) {
      for (Eigen::Index j = 0; j < v.at.size(); ++j) {
        const double error = values(j, i) - light[0] * t.value(j, i) - light[1] -
                             light[2] * u.at[i] - light[3] * v.at[j];
        const double share = error / limit;
        if (share * share >= 1) continue;
        const auto weight = static_cast<float>(1 - share * share);  // its square counts
        // Places relative to the middle, in half sides: all parameters alike in size.
        const auto x = static_cast<float>((u.at[i] - middle) / middle);
        const auto y = static_cast<float>((v.at[j] - middle) / middle);
        const auto gx = weight * static_cast<float>(light[0] * t.du(j, i) * middle);
        const auto gy = weight * static_cast<float>(light[0] * t.dv(j, i) * middle);
        const float inwards = -(gx * x + gy * y);
        const auto gain = weight * static_cast<float>(0.5 * light[0]);
        float* row = rows.col(used++).data();
        row[0] = gx * x;
        row[1] = gx * y;
        row[2] = gx;
        row[3] = gy * x;
        row[4] = gy * y;
        row[5] = gy;
        row[6] = inwards * x;
        row[7] = inwards * y;
        row[8] = gain * static_cast<float>(t.duu(j, i));
        row[9] = gain * static_cast<float>(t.dvv(j, i));
        row[10] = weight * static_cast<float>(t.value(j, i));
        row[11] = weight;
        row[12] = weight * x;
        row[13] = weight * y;
        row[14] = weight * static_cast<float>(error);
      }
    }
    const auto part = rows.leftCols(used);
    const Eigen::MatrixXd products = (part * part.transpose()).cast<double>();
    Normal normal = products.topLeftCorner<kParameters, kParameters>();
    const Row right = products.topRightCorner<kParameters, 1>();
    normal.diagonal() *= 1 + 1e-4;
    normal.diagonal().array() += 1e-9;
    const Row step = normal.ldlt().solve(right);
    if (!step.allFinite()) return std::nullopt;
    // T(W(x; p)) looks like the picture: the picture is looked at from W(x; p)^-1 on.
    Eigen::Matrix3d warp;
    warp << 1 + step[0], step[1], step[2], step[3], 1 + step[4], step[5], step[6], step[7], 1;
    Eigen::Matrix3d to_halves;
    to_halves << 1 / middle, 0, -1, 0, 1 / middle, -1, 0, 0, 1;
    Eigen::Matrix3d from_halves;
    from_halves << middle, 0, middle, 0, middle, middle, 0, 0, 1;
    const double determinant = warp.determinant();
    if (!(std::abs(determinant) > 0.1)) return std::nullopt;
    map = map * from_halves * warp.inverse() * to_halves;
    map /= map(2, 2);
    const auto next_blur = [](double blur, double change, double cell) {
      const double square = std::clamp(blur * blur + change, 0.25 * blur * blur, 4 * blur * blur);
      return std::clamp(std::sqrt(square), 0.35 / cell, 1.5);
    };
    blur_u = next_blur(blur_u, step[8], cell_u);
    blur_v = next_blur(blur_v, step[9], cell_v);
    if (!sample(gray, map, u, v, values)) return std::nullopt;
    u.blur(blur_u);
    v.blur(blur_v);
    t = template_of(pattern, u, v);
    light = fit_light(values, t, u, v);
    if (step.head<8>().cwiseAbs().maxCoeff() * middle * std::max(cell_u, cell_v) < 0.005) break;
  }
  light = fit_light(values, t, u, v);
  Alignment result;
  const std::array<Eigen::Vector2d, 4> corners{Eigen::Vector2d(0, 0), Eigen::Vector2d(n, 0),
                                               Eigen::Vector2d(n, n), Eigen::Vector2d(0, n)};
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d p = map * corners[k].homogeneous();
    if (!(p.z() > 0)) return std::nullopt;
    result.corners[k] = p.hnormalized();
    if (!((result.corners[k] - start[k]).norm() < 1.2 * std::max(cell_u, cell_v)))
      return std::nullopt;
  }
  if (light[0] <= 0) return std::nullopt;
  result.correlation = correlation_inside(values, t, u, v, light, cells);
  result.blur_px = std::min(blur_u * cell_u, blur_v * cell_v);
  return result;
}

}  // namespace tarsier::marker
