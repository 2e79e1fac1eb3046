// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/start.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/statistics.h"
#include "tarsier/face/appearance/fit_level.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tarsier::face::appearance {

using Eigen::Matrix2Xd;
using Eigen::Vector2d;

namespace {

double rms_radius(const Matrix2Xd& points) {
  const Vector2d center = points.rowwise().mean();
  return std::sqrt((points.colwise() - center).colwise().squaredNorm().mean());
}

// The points rotated about their centre, scaled and shifted.
Matrix2Xd moved(const Matrix2Xd& points, double scale, double angle, const Vector2d& shift) {
  const Vector2d center = points.rowwise().mean();
  const double a = scale * std::cos(angle);
  const double b = scale * std::sin(angle);
  Eigen::Matrix2d turn;
  turn << a, -b, b, a;
  return (turn * (points.colwise() - center)).colwise() + (center + shift);
}

}  // namespace

ShapeInBox learn_shape_in_box(const std::vector<std::pair<cv::Rect2d, Matrix2Xd>>& boxes) {
  TARSIER_REQUIRE(!boxes.empty(), "no boxes");
  std::vector<double> dx, dy, size;
  for (const auto& [box, points] : boxes) {
    TARSIER_REQUIRE(box.width > 0 && points.cols() >= 2 && points.allFinite(),
                    "a box {} wide with {} points", box.width, points.cols());
    const Vector2d center = points.rowwise().mean();
    dx.push_back((center.x() - box.x - box.width / 2) / box.width);
    dy.push_back((center.y() - box.y - box.height / 2) / box.width);
    size.push_back(rms_radius(points) / box.width);
  }
  return {upper_median(dx), upper_median(dy), upper_median(size), static_cast<int>(boxes.size())};
}

Matrix2Xd start_in_box(const AppearanceModel& model, const cv::Rect2d& box,
                       const Eigen::VectorXd& b) {
  TARSIER_REQUIRE(box.width > 0 && std::isfinite(box.x + box.y + box.width + box.height),
                  "a box {} wide", box.width);
  const Matrix2Xd shape = b.size() == 0 ? model.shape.mean : shape::shape_of(model.shape, b);
  const Vector2d center(box.x + box.width * (0.5 + model.shape_in_box.dx),
                        box.y + box.height / 2 + box.width * model.shape_in_box.dy);
  return (model.shape_in_box.size * box.width * shape).colwise() + center;
}

std::vector<Matrix2Xd> starts_around(const Matrix2Xd& start, int count, double spread) {
  TARSIER_REQUIRE(count >= 1 && count <= 1000, "{} starts", count);
  TARSIER_REQUIRE(spread >= 0 && std::isfinite(spread), "spread {}", spread);
  std::vector<Matrix2Xd> starts{start};
  const double size = rms_radius(start);
  // A low-discrepancy sequence (Roberts' R4: powers of the root of x^5 = x + 1).
  constexpr double kRoot = 1.1673039782614187;
  double steps[4];
  for (int k = 0; k < 4; ++k) steps[k] = std::pow(1 / kRoot, k + 1);
  for (int i = 1; i < count; ++i) {
    double u[4];
    for (int k = 0; k < 4; ++k) u[k] = 2 * std::fmod(0.5 + i * steps[k], 1.0) - 1;
    starts.push_back(moved(start, 1 + 0.14 * spread * u[0],
                           10 * spread * u[1] * std::numbers::pi / 180,
                           Vector2d(0.14 * spread * u[2], 0.14 * spread * u[3]) * size));
  }
  return starts;
}

Matrix2Xd disturbed(const Matrix2Xd& points, const Disturbance& disturbance, std::uint64_t seed) {
  TARSIER_REQUIRE(points.cols() >= 1 && points.allFinite(), "{} points; or not finite",
                  points.cols());
  Rng rng(seed);
  const Vector2d extent = points.rowwise().maxCoeff() - points.rowwise().minCoeff();
  const double scale = 1 + rng.uniform(-disturbance.scale, disturbance.scale);
  const double angle =
      rng.uniform(-disturbance.angle_deg, disturbance.angle_deg) * std::numbers::pi / 180;
  const double x = rng.uniform(-disturbance.shift, disturbance.shift) * extent.x();
  const double y = rng.uniform(-disturbance.shift, disturbance.shift) * extent.y();
  return moved(points, scale, angle, {x, y});
}

void SearchOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(smallest <= largest, "sizes {} to {}", smallest, largest);
}

std::optional<Matrix2Xd> search_start(const Fitter& fitter, const cv::Mat& image,
                                      const SearchOptions& options, FitWorkspace& workspace) {
  options.check();
  const AppearanceModel& model = fitter.model();
  const FitLevel& level = fitter.level(static_cast<int>(model.levels.size()) - 1);
  const Matrix2Xd mean = level.texture->px_per_unit * model.shape.mean;
  const Vector2d low = mean.rowwise().minCoeff();
  const Vector2d high = mean.rowwise().maxCoeff();
  const double width = high.x() - low.x();

  struct Candidate {
    double error;
    Matrix2Xd points;  // px of the image
  };
  std::vector<Candidate> candidates;
  const double side = std::min(image.cols, image.rows);
  const double step = std::max(1.0, options.place_step * width);
  for (double size = options.smallest; size <= options.largest * 1.0001;
       size *= options.scale_step) {
    // Reduces the whole image so that the object has the size of the coarsest frame.
    const double scale = size * side / width;  // px of the image per px of the reduced image
    const cv::Size all(std::max(2, static_cast<int>(image.cols / scale)),
                       std::max(2, static_cast<int>(image.rows / scale)));
    make_upright_crop(image, {scale, 0, (scale - 1) / 2, (scale - 1) / 2}, all,
                      level.texture->channels, workspace.upright);
    for (double y = -low.y(); y + high.y() < all.height; y += step) {
      for (double x = -low.x(); x + high.x() < all.width; x += step) {
        workspace.points = mean.colwise() + Vector2d(x, y);
        LevelState state;
        sample_texture(level, workspace, state);
        if (state.gain <= 0) continue;
        Matrix2Xd points = scale * workspace.points;
        points.array() += (scale - 1) / 2;
        candidates.push_back({state.error, std::move(points)});
      }
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.error < b.error; });
  // The best candidates, without neighbours of better ones.
  std::vector<Matrix2Xd> starts;
  for (const Candidate& candidate : candidates) {
    if (static_cast<int>(starts.size()) >= options.best) break;
    const Vector2d center = candidate.points.rowwise().mean();
    const double radius = rms_radius(candidate.points);
    const bool is_near = std::any_of(starts.begin(), starts.end(), [&](const Matrix2Xd& other) {
      const double ratio = rms_radius(other) / radius;
      return (other.rowwise().mean() - center).norm() < 0.3 * radius && ratio > 0.85 &&
             ratio < 1.18;
    });
    if (!is_near) starts.push_back(candidate.points);
  }
  if (starts.empty()) return std::nullopt;
  const FitResult best = fitter.fit_best(image, starts, workspace);
  if (best.lost) return std::nullopt;
  return best.points;
}

}  // namespace tarsier::face::appearance
