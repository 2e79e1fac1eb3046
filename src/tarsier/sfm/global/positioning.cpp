// SPDX-License-Identifier: MIT
#include "tarsier/sfm/global/positioning.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/sparse_cholesky.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

namespace tarsier::sfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

// in the start: lower limit of a residual, in units of the min depth
constexpr double kMinResidualRatio = 1e-3;
constexpr double kFirstDamping = 0.1;
constexpr double kMinDamping = 1e-10;
constexpr double kMaxDamping = 1e8;
// Share of the diagonal that is added to it: the origin and the scale are undetermined.
constexpr double kRegularization = 1e-9;
// For a step solved by conjugate gradients, with an earlier factorisation as preconditioner.
constexpr double kPreconditionedTolerance = 0.1;
constexpr int kMaxPreconditionedIterations = 6;

class Positioning {
 public:
  Positioning(const PositioningProblem& problem, const PositioningOptions& options,
              const std::stop_token& stop)
      : problem_(problem), options_(options), stop_(stop) {
    result_.cameras.assign(at(problem.cameras), Vector3d::Zero());
    result_.points.assign(points(), Vector3d::Zero());
    find_pattern();
  }

  std::optional<PositionedCameras> run() {
    if (!start()) return std::nullopt;
    minimise(options_.loss, options_.tolerance);
    minimise(options_.last_loss, options_.last_tolerance);
    for (std::size_t p = 0; p < points(); ++p)
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k)
        result_.errors.push_back(perpendicular(k, result_.cameras, result_.points[p]).norm());
    return std::move(result_);
  }

 private:
  [[nodiscard]] std::size_t points() const { return problem_.first.size() - 1; }
  [[nodiscard]] const Vector3d& direction(std::size_t ray) const {
    return problem_.rays[ray].direction;
  }
  [[nodiscard]] int camera(std::size_t ray) const { return problem_.rays[ray].camera; }

  // Pairs of cameras that see the same point, row <= column, ordered by column.
  void find_pattern() {
    std::vector<std::uint64_t> pairs;
    const auto sort_unique = [&] {
      std::sort(pairs.begin(), pairs.end());
      pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
    };
    std::size_t unique_count = 0;
    for (std::size_t p = 0; p < points(); ++p) {
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k)
        for (std::size_t l = problem_.first[p]; l <= k; ++l) pairs.push_back(key(k, l));
      if (pairs.size() > 2 * unique_count + 1'000'000) {
        sort_unique();
        unique_count = pairs.size();
      }
    }
    for (int c = 0; c < problem_.cameras; ++c)
      pairs.push_back(static_cast<std::uint64_t>(c) << 32 | static_cast<std::uint64_t>(c));
    sort_unique();
    column_first_.assign(at(problem_.cameras) + 1, 0);
    for (const std::uint64_t pair : pairs) {
      rows_.push_back(static_cast<int>(pair & 0xffffffffU));
      ++column_first_[(pair >> 32) + 1];
    }
    for (std::size_t c = 0; c < at(problem_.cameras); ++c) column_first_[c + 1] += column_first_[c];
    for (std::size_t p = 0; p < points(); ++p)
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k)
        for (std::size_t l = problem_.first[p]; l <= k; ++l)
          pair_blocks_.push_back(static_cast<std::uint32_t>(
              block_of(std::min(camera(k), camera(l)), std::max(camera(k), camera(l)))));
  }

  [[nodiscard]] std::uint64_t key(std::size_t k, std::size_t l) const {
    const int low = std::min(camera(k), camera(l));
    const int high = std::max(camera(k), camera(l));
    return static_cast<std::uint64_t>(high) << 32 | static_cast<std::uint64_t>(low);
  }

  [[nodiscard]] std::size_t block_of(int row, int column) const {
    const auto begin = rows_.begin() + static_cast<std::ptrdiff_t>(column_first_[at(column)]);
    const auto end = rows_.begin() + static_cast<std::ptrdiff_t>(column_first_[at(column) + 1]);
    return static_cast<std::size_t>(std::lower_bound(begin, end, row) - rows_.begin());
  }

  // Index of a camera's diagonal block, the last one of its column.
  [[nodiscard]] std::size_t diagonal(int camera) const { return column_first_[at(camera) + 1] - 1; }

  // The non-zero blocks of the cameras' equations, with `size` unknowns per camera.
  [[nodiscard]] linalg::BlockPattern pattern_of(int size) const {
    linalg::BlockPattern pattern;
    for (int c = 0; c <= problem_.cameras; ++c) pattern.first.push_back(size * c);
    for (int column = 0; column < problem_.cameras; ++column)
      for (std::size_t b = column_first_[at(column)]; b < column_first_[at(column) + 1]; ++b)
        pattern.blocks.push_back({rows_[b], column});
    return pattern;
  }

  // --- start ---

  bool start() {
    linalg::SparseCholesky factor;
    factor.analyze(pattern_of(1));
    std::vector<double> weights(problem_.rays.size(), 1);
    std::vector<double> depths(problem_.rays.size(), 1);
    for (int iteration = 0; iteration < options_.start_iterations; ++iteration) {
      throw_if_stopped(stop_);
      std::vector<double> numbers(rows_.size(), 0);
      Eigen::MatrixX3d right = Eigen::MatrixX3d::Zero(problem_.cameras, 3);
      std::vector<Vector3d> means(points(),
                                  // mean end of a point's rays, relative to their cameras
                                  Vector3d::Zero());
      std::vector<double> sums(points(), 0);
      double max_diagonal = 0;
      const std::uint32_t* pair_block = pair_blocks_.data();
      for (std::size_t p = 0; p < points(); ++p) {
        for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
          sums[p] += weights[k];
          means[p] += weights[k] * depths[k] * direction(k);
        }
        means[p] /= sums[p];
        for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
          const int i = camera(k);
          numbers[diagonal(i)] += weights[k];
          right.row(i) += weights[k] * (means[p] - depths[k] * direction(k)).transpose();
          for (std::size_t l = problem_.first[p]; l <= k; ++l)
            numbers[*pair_block++] -= weights[k] * weights[l] / sums[p];
        }
      }
      for (int i = 0; i < problem_.cameras; ++i)
        max_diagonal = std::max(max_diagonal, numbers[diagonal(i)]);
      if (!(max_diagonal > 0)) return false;
      // The origin is undetermined, so a weak pull to zero fixes it.
      for (int i = 0; i < problem_.cameras; ++i) numbers[diagonal(i)] += 1e-9 * max_diagonal;
      if (!factor.factorize(numbers)) return false;
      Eigen::MatrixX3d centers(problem_.cameras, 3);
      for (int c = 0; c < 3; ++c) centers.col(c) = factor.solve(right.col(c));
      if (!centers.allFinite()) return false;
      for (int i = 0; i < problem_.cameras; ++i)
        result_.cameras[at(i)] = centers.row(i).transpose();
      for (std::size_t p = 0; p < points(); ++p) {
        Vector3d& point = result_.points[p] = means[p];
        for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k)
          point += weights[k] / sums[p] * result_.cameras[at(camera(k))];
        for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
          const Vector3d to = point - result_.cameras[at(camera(k))];
          depths[k] = std::max(1.0, direction(k).dot(to));
          weights[k] = 1 / std::max(kMinResidualRatio, (to - depths[k] * direction(k)).norm());
        }
      }
    }
    return true;
  }

  // --- refinement ---

  // The component of a ray perpendicular to the direction of its point; the whole ray where the
  // point is behind the camera.
  [[nodiscard]] Vector3d perpendicular(std::size_t ray, const std::vector<Vector3d>& cameras,
                                       const Vector3d& point) const {
    const Vector3d to = point - cameras[at(camera(ray))];
    const double along = direction(ray).dot(to);
    return along > 0 ? Vector3d(direction(ray) - along / to.squaredNorm() * to) : direction(ray);
  }

  [[nodiscard]] double cost(const std::vector<Vector3d>& cameras, const std::vector<Vector3d>& all,
                            double loss) const {
    double sum = 0;
    for (std::size_t p = 0; p < points(); ++p) {
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        const double error = perpendicular(k, cameras, all[p]).norm();
        sum += error <= loss ? error * error : 2 * loss * error - loss * loss;
      }
    }
    return sum / 2;
  }

  struct Positions {
    std::vector<Vector3d> cameras;
    std::vector<Vector3d> points;
  };

  // The cameras after a step of the reduced equations, and the points that follow from them.
  [[nodiscard]] Positions moved_by(const VectorXd& step) const {
    Positions moved{result_.cameras, result_.points};
    for (std::size_t i = 0; i < moved.cameras.size(); ++i)
      moved.cameras[i] += step.segment<3>(3 * static_cast<Eigen::Index>(i));
    for (std::size_t p = 0; p < points(); ++p) {
      Vector3d descent = point_gradients_[p];
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k)
        descent += ray_hessians_[k] * step.segment<3>(3 * static_cast<Eigen::Index>(camera(k)));
      moved.points[p] += inverses_[p] * descent;
    }
    return moved;
  }

  void minimise(double loss, double tolerance) {
    linalg::SparseCholesky factor;
    factor.analyze(pattern_of(3));
    bool is_factorized = false;
    double damping = kFirstDamping;
    double growth = 2;
    double sum = cost(result_.cameras, result_.points, loss);
    for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
      throw_if_stopped(stop_);
      ++result_.iterations;
      linearize(loss, damping);
      const std::vector<double> numbers = reduce();
      std::optional<VectorXd> solution;
      if (is_factorized && factor.is_costly())
        solution = factor.solve_near(numbers, right_, kPreconditionedTolerance,
                                     kMaxPreconditionedIterations);
      if (!solution) {
        is_factorized = factor.factorize(numbers);
        if (is_factorized) solution = factor.solve(right_);
      }
      bool is_better = false;
      if (solution && solution->allFinite()) {
        Positions moved = moved_by(*solution);
        const double candidate = cost(moved.cameras, moved.points, loss);
        is_better = std::isfinite(candidate) && candidate < sum;
        if (is_better) {
          const bool is_done = sum - candidate <= tolerance * sum;
          result_.cameras = std::move(moved.cameras);
          result_.points = std::move(moved.points);
          sum = candidate;
          if (is_done) return;
        }
      }
      if (is_better) {
        damping = std::max(kMinDamping, damping / 5);
        growth = 2;
      } else {
        damping *= growth;
        growth *= 2;
        if (damping > kMaxDamping) return;
      }
    }
  }

  // Each ray is a spring between its camera and its point, perpendicular to the line between them.
  // Along this line the cost has no curvature. `damping` adds it, as a share of that perpendicular
  // to the line. So it limits changes of depth, which make steps fail, but not the common movements
  // of neighbouring cameras and points by which a long chain bends. With a damping of 1, the step
  // minimises an upper bound of the cost: that for the current d_ik.
  void linearize(double loss, double damping) {
    ray_hessians_.assign(problem_.rays.size(), Matrix3d::Zero());
    point_hessians_.assign(points(), Matrix3d::Zero());
    point_gradients_.assign(points(), Vector3d::Zero());
    camera_hessians_.assign(at(problem_.cameras), Matrix3d::Zero());
    camera_gradient_ = VectorXd::Zero(3 * problem_.cameras);
    for (std::size_t p = 0; p < points(); ++p) {
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        const int i = camera(k);
        const Vector3d to = result_.points[p] - result_.cameras[at(i)];
        const double along = direction(k).dot(to);
        const double squares = to.squaredNorm();
        if (!(along > 0)) continue;  // behind the camera: no helpful step is known
        const double d = along / squares;
        const Vector3d error = direction(k) - d * to;
        const double weight = std::min(1.0, loss / std::max(loss, error.norm()));
        ray_hessians_[k] =
            weight * d * d * (Matrix3d::Identity() - (1 - damping) / squares * to * to.transpose());
        point_hessians_[p] += ray_hessians_[k];
        camera_hessians_[at(i)] += ray_hessians_[k];
        const Vector3d descent = weight * d * error;
        point_gradients_[p] += descent;
        camera_gradient_.segment<3>(3 * static_cast<Eigen::Index>(i)) -= descent;
      }
    }
  }

  // The cameras' equations after elimination of the points.
  std::vector<double> reduce() {
    std::vector<double> numbers(9 * rows_.size(), 0);
    right_ = camera_gradient_;
    const auto numbers_of = [&](std::size_t block) {
      return Eigen::Map<Matrix3d>(numbers.data() + 9 * block);
    };
    const auto regularized = [](Matrix3d hessian) {
      hessian.diagonal().array() += kRegularization * hessian.trace() / 3 + 1e-30;
      return hessian;
    };
    for (int i = 0; i < problem_.cameras; ++i)
      numbers_of(diagonal(i)) = regularized(camera_hessians_[at(i)]);
    inverses_.resize(points());
    const std::uint32_t* pair_block = pair_blocks_.data();
    for (std::size_t p = 0; p < points(); ++p) {
      const Matrix3d inverse = inverses_[p] =
          regularized(point_hessians_[p]).ldlt().solve(Matrix3d::Identity());
      const Vector3d descent = inverse * point_gradients_[p];
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        const int i = camera(k);
        right_.segment<3>(3 * static_cast<Eigen::Index>(i)) += ray_hessians_[k] * descent;
        const Matrix3d scaled = ray_hessians_[k] * inverse;
        for (std::size_t l = problem_.first[p]; l <= k; ++l) {
          const Matrix3d product = scaled * ray_hessians_[l];
          Eigen::Map<Matrix3d> block = numbers_of(*pair_block++);
          if (i <= camera(l))
            block -= product;
          else
            block -= product.transpose();
        }
      }
    }
    return numbers;
  }

  const PositioningProblem& problem_;
  const PositioningOptions& options_;
  const std::stop_token& stop_;
  PositionedCameras result_;
  std::vector<std::size_t> column_first_;  // index of each column's first block
  std::vector<int> rows_;                  // of each block
  // for each two rays of a point: index of their block; the second ray is not after the first
  std::vector<std::uint32_t> pair_blocks_;
  std::vector<Matrix3d> ray_hessians_;  // for each ray
  std::vector<Matrix3d> point_hessians_;
  std::vector<Matrix3d> camera_hessians_;
  std::vector<Vector3d> point_gradients_;  // for each point, descent direction
  VectorXd camera_gradient_;
  VectorXd right_;
  std::vector<Matrix3d> inverses_;
};

}  // namespace

std::optional<PositionedCameras> position_cameras(const PositioningProblem& problem,
                                                  const PositioningOptions& options,
                                                  const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(!problem.first.empty() && problem.first.back() == problem.rays.size(),
                  "{} rays, but the points refer to another number", problem.rays.size(),
                  problem.first.size());
  for (std::size_t p = 0; p + 1 < problem.first.size(); ++p)
    TARSIER_REQUIRE(problem.first[p] + 2 <= problem.first[p + 1],
                    "point {} has fewer than two rays", p);
  for (const PositioningProblem::Ray& ray : problem.rays)
    TARSIER_REQUIRE(ray.camera >= 0 && ray.camera < problem.cameras, "camera {} of {}", ray.camera,
                    problem.cameras);
  if (problem.cameras < 2 || problem.rays.empty()) return std::nullopt;
  return Positioning(problem, options, stop).run();
}

}  // namespace tarsier::sfm
