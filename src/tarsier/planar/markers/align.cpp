// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/align.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace tarsier::planar::markers {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kLights = 8;                    // gain, offset, two slopes, four surroundings
constexpr int kParameters = 8 + 2 + kLights;  // of the homography, of blur, of light
using Light = Eigen::Matrix<double, kLights, 1>;
using Row = Eigen::Matrix<double, kParameters, 1>;
using Normal = Eigen::Matrix<double, kParameters, kParameters>;
// One row per sample: its derivatives, then its error. Single precision is enough for a step.
using Rows = Eigen::Matrix<float, kParameters + 1, Eigen::Dynamic>;

// Sample positions along one side, in cells from the marker's corner, and the weight of each column
// of cells in a blurred pixel there: weight(i, k) of column k - 1, with its first two derivatives.
struct Axis {
  VectorXd at;
  MatrixXd weight;
  MatrixXd slope;
  MatrixXd bend;
  // Weight beyond a margin of one cell, on either side: the paper may end there.
  VectorXd before;
  VectorXd beyond;

  Axis(int samples, int columns, double margin) {
    at.resize(samples);
    const double length = columns + 2 * margin;
    for (int i = 0; i < samples; ++i) at[i] = -margin + length * (i + 0.5) / samples;
    weight.resize(samples, columns + 2);
    slope.resize(samples, columns + 2);
    bend.resize(samples, columns + 2);
    before.resize(samples);
    beyond.resize(samples);
  }
  void blur(double sigma) {
    const auto columns = weight.cols();
    const auto share_below = [](double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); };
    for (Eigen::Index i = 0; i < at.size(); ++i) {
      before[i] = share_below((-1 - at[i]) / sigma);
      beyond[i] = share_below((at[i] - static_cast<double>(columns) + 1) / sigma);
      // The step at k, k = 0 .. columns - 2, seen from at[i]; the paper continues without end.
      double last = 0;
      double last_slope = 0;
      double last_bend = 0;
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
            // d/du of Phi((k - u) / s) = -phi / s, and its derivative
            const double phi = std::exp(-0.5 * z * z) / (sigma * std::sqrt(2 * std::numbers::pi));
            step_slope = -phi;
            step_bend = -phi * z / sigma;
          }
        }
        weight(i, k) = step - last;
        slope(i, k) = step_slope - last_slope;
        bend(i, k) = step_bend - last_bend;
        last = step;
        last_slope = step_slope;
        last_bend = step_bend;
      }
    }
  }
};

// The marker and a margin of paper: 1 white, -1 black.
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

// Samples the image at the template's positions; kOutside where there is no pixel. False if fewer
// than two thirds lie inside.
constexpr double kOutside = -1;
constexpr double kStiffness = 1e-2;  // of the surroundings, relative to the number of samples
bool sample(const cv::Mat& gray, const Eigen::Matrix3d& map, const Axis& u, const Axis& v,
            MatrixXd& values) {
  values.resize(v.at.size(), u.at.size());
  Eigen::Index outside = 0;
  for (Eigen::Index i = 0; i < u.at.size(); ++i) {
    const Eigen::Vector3d start = map.col(0) * u.at[i] + map.col(2);
    for (Eigen::Index j = 0; j < v.at.size(); ++j) {
      const Eigen::Vector3d p = start + map.col(1) * v.at[j];
      const double shrink = 1 / p.z();
      const double x = p.x() * shrink;
      const double y = p.y() * shrink;
      if (!(p.z() > 0 && x >= 0 && y >= 0 && x < gray.cols - 1.001 && y < gray.rows - 1.001)) {
        values(j, i) = kOutside;
        ++outside;
        continue;
      }
      const int x0 = static_cast<int>(x);
      const int y0 = static_cast<int>(y);
      const double fx = x - x0;
      const double fy = y - y0;
      const auto* a = gray.ptr<std::uint8_t>(y0) + x0;
      const auto* b = gray.ptr<std::uint8_t>(y0 + 1) + x0;
      values(j, i) = (1 - fy) * (a[0] + fx * (a[1] - a[0])) + fy * (b[0] + fx * (b[1] - b[0]));
    }
  }
  return 3 * outside < values.size();
}

// Factors of the light parameters at a position: T, 1, u, v, and the visible share of the
// surroundings.
Light light_row(const Template& t, const Axis& u, const Axis& v, Eigen::Index i, Eigen::Index j) {
  Light row;
  row << t.value(j, i), 1, u.at[i], v.at[j], u.before[i], u.beyond[i], v.before[j], v.beyond[j];
  return row;
}

// Least squares of values = light . light_row. Surroundings that are hardly visible stay paper.
Light fit_light(const MatrixXd& values, const Template& t, const Axis& u, const Axis& v) {
  Eigen::Matrix<double, kLights, kLights> normal = Eigen::Matrix<double, kLights, kLights>::Zero();
  Light right = Light::Zero();
  for (Eigen::Index i = 0; i < u.at.size(); ++i) {
    for (Eigen::Index j = 0; j < v.at.size(); ++j) {
      if (values(j, i) == kOutside) continue;
      const Light row = light_row(t, u, v, i, j);
      normal.selfadjointView<Eigen::Lower>().rankUpdate(row);
      right += values(j, i) * row;
    }
  }
  normal = normal.selfadjointView<Eigen::Lower>();
  normal.diagonal().tail<4>().array() += kStiffness * normal(1, 1);
  return linalg::solve_symmetric(normal, right);
}

double correlation_inside(const MatrixXd& values, const Template& t, const Axis& u, const Axis& v,
                          const Light& light, int cells) {
  double n = 0;
  double x = 0;
  double y = 0;
  double xx = 0;
  double yy = 0;
  double xy = 0;
  for (Eigen::Index i = 0; i < u.at.size(); ++i) {
    if (u.at[i] < 1 || u.at[i] > cells + 1) continue;
    for (Eigen::Index j = 0; j < v.at.size(); ++j) {
      if (v.at[j] < 1 || v.at[j] > cells + 1 || values(j, i) == kOutside) continue;
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

// The homography's part of the normal equations with blur and light eliminated (Schur complement),
// transformed from its parameters to the corners.
bool corner_information(const Normal& normal, double noise, const Eigen::Matrix3d& map,
                        double half_size, std::array<double, 64>& information) {
  const Eigen::Matrix<double, 8, 8> of_map = normal.topLeftCorner<8, 8>();
  const Eigen::Matrix<double, 8, kParameters - 8> mixed =
      normal.topRightCorner<8, kParameters - 8>();
  Eigen::Matrix<double, kParameters - 8, kParameters - 8> others =
      normal.bottomRightCorner<kParameters - 8, kParameters - 8>();
  others.diagonal() *= 1 + 1e-9;
  others.diagonal().array() += 1e-9;
  Eigen::Matrix<double, 8, 8> known =
      of_map - mixed * linalg::solve_symmetric(others, mixed.transpose());
  // Jacobian of the corners with respect to the parameters of a small warp before the map.
  Eigen::Matrix<double, 8, 8> jacobian;
  const Eigen::Matrix<double, 4, 2> signs{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
  for (int k = 0; k < 4; ++k) {
    const double x = signs(k, 0);
    const double y = signs(k, 1);
    Eigen::Matrix<double, 2, 8> moves;
    moves << x, y, 1, 0, 0, 0, -x * x, -x * y, 0, 0, 0, x, y, 1, -x * y, -y * y;
    const Eigen::Vector3d p = map * Eigen::Vector3d(half_size * (x + 1), half_size * (y + 1), 1);
    Eigen::Matrix2d pixel_by_point;
    pixel_by_point << map(0, 0) - map(2, 0) * p.x() / p.z(), map(0, 1) - map(2, 1) * p.x() / p.z(),
        map(1, 0) - map(2, 0) * p.y() / p.z(), map(1, 1) - map(2, 1) * p.y() / p.z();
    jacobian.middleRows<2>(2 * k) = pixel_by_point * (half_size / p.z()) * moves;
  }
  // Blur and noise differ slightly from the model, which limits the certainty of a corner.
  constexpr double kModel = 0.1;  // px
  known.diagonal() *= 1 + 1e-9;
  known.diagonal().array() += 1e-9;
  const Eigen::Matrix<double, 8, 8> covariance =
      std::max(noise, 1e-3) * jacobian * linalg::solve_symmetric(known, jacobian.transpose()) +
      kModel * kModel * Eigen::Matrix<double, 8, 8>::Identity();
  const Eigen::Matrix<double, 8, 8> result =
      linalg::solve_symmetric(covariance, Eigen::Matrix<double, 8, 8>::Identity());
  if (!result.allFinite()) return false;
  Eigen::Map<Eigen::Matrix<double, 8, 8>>(information.data()) = 0.5 * (result + result.transpose());
  return true;
}

// The state of the fit, and its data.
class Fit {
 public:
  Fit(const cv::Mat& gray, Code seen, int cells, const Quad& start, const AlignOptions& options)
      : gray_(gray),
        cells_(cells),
        size_(cells + 2),
        cell_u_(mean_side(start, 0) / size_),
        cell_v_(mean_side(start, 1) / size_),
        u_(samples(cell_u_, options), size_, options.margin),
        v_(samples(cell_v_, options), size_, options.margin),
        pattern_(pattern_of(seen, cells)),
        map_(image_from_cells(start, cells)),
        blur_u_(0.8 / cell_u_),
        blur_v_(0.8 / cell_v_),
        rows_(kParameters + 1, u_.at.size() * v_.at.size()) {}

  // Samples the image and renders the marker for the current parameters, with the light fitted to
  // it.
  bool begin() {
    if (!look()) return false;
    light_ = fit_light(values_, template_, u_, v_);
    return true;
  }

  // One Gauss-Newton step. Returns the maximum motion of a corner, px, or nothing if it fails.
  std::optional<double> step() {
    linearize();
    Normal damped = normal_;
    damped.diagonal() *= 1 + 1e-4;
    damped.diagonal().array() += 1e-9;
    const Row step = linalg::solve_symmetric(damped, right_);
    if (!step.allFinite()) return std::nullopt;
    // The marker warped by W resembles the image, so the map is composed with W^-1.
    const double half_size = 0.5 * size_;
    Eigen::Matrix3d warp;
    warp << 1 + step[0], step[1], step[2], step[3], 1 + step[4], step[5], step[6], step[7], 1;
    if (!(std::abs(warp.determinant()) > 0.1)) return std::nullopt;
    Eigen::Matrix3d to_halves;
    to_halves << 1 / half_size, 0, -1, 0, 1 / half_size, -1, 0, 0, 1;
    Eigen::Matrix3d from_halves;
    from_halves << half_size, 0, half_size, 0, half_size, half_size, 0, 0, 1;
    map_ = map_ * from_halves * warp.inverse() * to_halves;
    map_ /= map_(2, 2);
    blur_u_ = next_blur(blur_u_, step[8], cell_u_);
    blur_v_ = next_blur(blur_v_, step[9], cell_v_);
    // Slopes of light are in half sides from the centre there, and in cells here.
    Light change = step.tail<kLights>();
    change.segment<2>(2) /= half_size;
    change[1] -= half_size * (change[2] + change[3]);
    light_ += change;
    if (!look()) return std::nullopt;
    return step.head<8>().cwiseAbs().maxCoeff() * half_size * std::max(cell_u_, cell_v_);
  }

  [[nodiscard]] std::optional<Alignment> result(const Quad& start) const {
    if (!(light_[0] > 0)) return std::nullopt;
    Alignment result;
    const double n = size_;
    const std::array<Eigen::Vector2d, 4> corners{Eigen::Vector2d(0, 0), Eigen::Vector2d(n, 0),
                                                 Eigen::Vector2d(n, n), Eigen::Vector2d(0, n)};
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d p = map_ * corners[k].homogeneous();
      if (!(p.z() > 0)) return std::nullopt;
      result.corners[k] = p.hnormalized();
      if (!((result.corners[k] - start[k]).norm() < kMaxMove * std::max(cell_u_, cell_v_)))
        return std::nullopt;
    }
    if (!corner_information(normal_, noise_, map_, 0.5 * n, result.information))
      return std::nullopt;
    result.correlation = correlation_inside(values_, template_, u_, v_, light_, cells_);
    result.blur_px = std::min(blur_u_ * cell_u_, blur_v_ * cell_v_);
    return result;
  }

 private:
  static constexpr double kMaxMove = 1.2;  // cells

  bool look() {
    if (!sample(gray_, map_, u_, v_, values_)) return false;
    u_.blur(blur_u_);
    v_.blur(blur_v_);
    template_ = template_of(pattern_, u_, v_);
    return true;
  }
  static double mean_side(const Quad& quad, std::size_t k) {
    return 0.5 *
           ((quad[(k + 1) % 4] - quad[k]).norm() + (quad[(k + 2) % 4] - quad[(k + 3) % 4]).norm());
  }
  [[nodiscard]] int samples(double cell, const AlignOptions& options) const {
    return std::clamp(static_cast<int>((size_ + 2 * options.margin) * cell), 2 * size_,
                      std::max(2 * size_, options.max_samples));
  }
  static double next_blur(double blur, double change, double cell) {
    const double square = std::clamp(blur * blur + change, 0.25 * blur * blur, 4 * blur * blur);
    return std::clamp(std::sqrt(square), 0.35 / cell, 1.5);
  }
  // Fills errors_. Returns the limit beyond which an error has no weight: such pixels do not belong
  // to the marker (fingers, glare).
  [[nodiscard]] double find_errors() {
    errors_.resize(values_.rows(), values_.cols());
    const VectorXd of_rows = light_[3] * v_.at + light_[6] * v_.before + light_[7] * v_.beyond;
    sizes_.clear();
    for (Eigen::Index i = 0; i < u_.at.size(); ++i) {
      const double of_column =
          light_[1] + light_[2] * u_.at[i] + light_[4] * u_.before[i] + light_[5] * u_.beyond[i];
      for (Eigen::Index j = 0; j < v_.at.size(); ++j) {
        const double e = values_(j, i) - light_[0] * template_.value(j, i) - of_column - of_rows[j];
        errors_(j, i) = e;
        if (values_(j, i) != kOutside) sizes_.push_back(static_cast<float>(std::abs(e)));
      }
    }
    return 7 * std::max(1.0, 1.4826 * static_cast<double>(upper_quantile(sizes_, 0.5)));
  }
  void linearize() {
    const double most = find_errors();
    const double half_size = 0.5 * size_;
    Eigen::Index used = 0;
    for (Eigen::Index i = 0; i < u_.at.size(); ++i) {
      for (Eigen::Index j = 0; j < v_.at.size(); ++j) {
        if (values_(j, i) == kOutside) continue;
        const double e = errors_(j, i);
        const double share = e / most;
        if (share * share >= 1) continue;
        const auto weight = static_cast<float>(1 - share * share);  // it is used squared
        // Positions relative to the centre, in half sides, so that all parameters have similar
        // scales.
        const auto x = static_cast<float>((u_.at[i] - half_size) / half_size);
        const auto y = static_cast<float>((v_.at[j] - half_size) / half_size);
        const auto gx = weight * static_cast<float>(light_[0] * template_.du(j, i) * half_size);
        const auto gy = weight * static_cast<float>(light_[0] * template_.dv(j, i) * half_size);
        const float inwards = -(gx * x + gy * y);
        const auto gain = weight * static_cast<float>(0.5 * light_[0]);
        float* row = rows_.col(used++).data();
        row[0] = gx * x;
        row[1] = gx * y;
        row[2] = gx;
        row[3] = gy * x;
        row[4] = gy * y;
        row[5] = gy;
        row[6] = inwards * x;
        row[7] = inwards * y;
        row[8] = gain * static_cast<float>(template_.duu(j, i));
        row[9] = gain * static_cast<float>(template_.dvv(j, i));
        row[10] = weight * static_cast<float>(template_.value(j, i));
        row[11] = weight;
        row[12] = weight * x;
        row[13] = weight * y;
        row[14] = weight * static_cast<float>(u_.before[i]);
        row[15] = weight * static_cast<float>(u_.beyond[i]);
        row[16] = weight * static_cast<float>(v_.before[j]);
        row[17] = weight * static_cast<float>(v_.beyond[j]);
        row[18] = weight * static_cast<float>(e);
      }
    }
    const auto part = rows_.leftCols(used);
    Eigen::Matrix<float, kParameters + 1, kParameters + 1> lower;
    lower.setZero();
    lower.selfadjointView<Eigen::Lower>().rankUpdate(part);
    const Eigen::Matrix<double, kParameters + 1, kParameters + 1> products =
        lower.selfadjointView<Eigen::Lower>().toDenseMatrix().cast<double>();
    normal_ = products.topLeftCorner<kParameters, kParameters>();
    right_ = products.topRightCorner<kParameters, 1>();
    // Surroundings that are hardly visible stay paper.
    const double stiffness = kStiffness * normal_(11, 11);
    normal_.diagonal().tail<4>().array() += stiffness;
    right_.tail<4>() -= stiffness * light_.tail<4>();
    noise_ =
        products(kParameters, kParameters) / static_cast<double>(std::max<Eigen::Index>(1, used));
  }

  const cv::Mat& gray_;
  int cells_;
  int size_;       // cells per side, with the frame
  double cell_u_;  // px
  double cell_v_;
  Axis u_;
  Axis v_;
  MatrixXd pattern_;
  Eigen::Matrix3d map_;  // image from cells
  double blur_u_;        // cells
  double blur_v_;
  Rows rows_;
  std::vector<float> sizes_;
  MatrixXd values_;
  MatrixXd errors_;
  Template template_;
  Light light_ = Light::Zero();
  Normal normal_ = Normal::Zero();
  Row right_ = Row::Zero();
  double noise_ = 1;  // mean squared error, grey levels
};

}  // namespace

std::optional<Alignment> align_marker(const cv::Mat& gray, Code seen, int cells, const Quad& start,
                                      const AlignOptions& options) {
  options.check();
  TARSIER_REQUIRE(gray.type() == CV_8UC1, "an image that is not grey");
  constexpr double kStill = 0.02;  // px
  Fit fit(gray, seen, cells, start, options);
  if (!fit.begin()) return std::nullopt;
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    const auto moved = fit.step();
    if (!moved) return std::nullopt;
    if (*moved < kStill) break;
  }
  return fit.result(start);
}

}  // namespace tarsier::planar::markers
