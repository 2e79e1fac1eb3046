// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/robust_two_view.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/geometry/epipolar.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

namespace tarsier::sfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Vector9 = Eigen::Matrix<double, 9, 1>;
using Vector5 = Eigen::Matrix<double, 5, 1>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr int kMaxRefinements = 4;
constexpr int kMaxFinalRefinements = 10;

// Min work before a model is accepted.
struct Effort {
  int min_samples = 1;
  double refine_cost_ratio =
      1;  // a model is refined if its cost is below this times the lowest cost
};
// A motion with most inliers may still be wrong: it fits a plane that fills both images.
constexpr Effort kMotionEffort{.min_samples = 30, .refine_cost_ratio = 2};
constexpr double kUniformAfterSamples = 20000;  // after these, PROSAC equals uniform sampling

// Coordinates in columns, for vectorised error computation.
struct Columns {
  std::vector<double> x, y, u, v;

  explicit Columns(const PointPairs& pairs) {
    for (const Vector2d& p : pairs.first) {
      x.push_back(p[0]);
      y.push_back(p[1]);
    }
    for (const Vector2d& p : pairs.second) {
      u.push_back(p[0]);
      v.push_back(p[1]);
    }
  }
  [[nodiscard]] int count() const { return static_cast<int>(x.size()); }
};

// Sampson's squared distances of the pairs [from, to).
void sampson(const Matrix3d& e, const Columns& c, int from, int to, double* out) {
  const double e00 = e(0, 0), e01 = e(0, 1), e02 = e(0, 2);
  const double e10 = e(1, 0), e11 = e(1, 1), e12 = e(1, 2);
  const double e20 = e(2, 0), e21 = e(2, 1), e22 = e(2, 2);
  const double* const x = c.x.data();
  const double* const y = c.y.data();
  const double* const u = c.u.data();
  const double* const v = c.v.data();
  for (int i = from; i < to; ++i) {
    const double a0 = e00 * x[i] + e01 * y[i] + e02;
    const double a1 = e10 * x[i] + e11 * y[i] + e12;
    const double a2 = e20 * x[i] + e21 * y[i] + e22;
    const double b0 = e00 * u[i] + e10 * v[i] + e20;
    const double b1 = e01 * u[i] + e11 * v[i] + e21;
    const double algebraic_error = u[i] * a0 + v[i] * a1 + a2;
    out[i - from] =
        algebraic_error * algebraic_error / (a0 * a0 + a1 * a1 + b0 * b0 + b1 * b1 + 1e-300);
  }
}

// Squared distances between the second points and the mapped first points.
void transfer(const Matrix3d& h, const Columns& c, int from, int to, double* out) {
  const double h00 = h(0, 0), h01 = h(0, 1), h02 = h(0, 2);
  const double h10 = h(1, 0), h11 = h(1, 1), h12 = h(1, 2);
  const double h20 = h(2, 0), h21 = h(2, 1), h22 = h(2, 2);
  for (int i = from; i < to; ++i) {
    const double x = c.x[at(i)];
    const double y = c.y[at(i)];
    const double w = h20 * x + h21 * y + h22;
    const double scale = w != 0 ? 1 / w : std::numeric_limits<double>::infinity();
    const double dx = (h00 * x + h01 * y + h02) * scale - c.u[at(i)];
    const double dy = (h10 * x + h11 * y + h12) * scale - c.v[at(i)];
    const double d = dx * dx + dy * dy;
    out[i - from] = d == d ? d : std::numeric_limits<double>::infinity();
  }
}

using Errors = void (*)(const Matrix3d&, const Columns&, int, int, double*);

struct ScoredModel {
  Matrix3d matrix = Matrix3d::Zero();
  double cost = std::numeric_limits<double>::infinity();  // sum of min(error2 / threshold2, 1)
  int inliers = 0;
};

class Ransac {
 public:
  Ransac(const PointPairs& pairs, const RobustOptions& options, Errors errors,
         const Effort& effort = {})
      : pairs_(pairs),
        options_(options),
        effort_(effort),
        columns_(pairs),
        errors_(errors),
        rng_(options.seed) {
    const double t = options.threshold;
    squared_threshold_ = t * t;
  }

  // `solve(sample)` returns models of kSize pairs; `refine(matrix)` returns one that fits the
  // inliers better.
  template <int kSize, typename Solve, typename Refine>
  ScoredModel run(const Solve& solve, const Refine& refine) {
    const int count = columns_.count();
    ScoredModel best;
    if (count < kSize) return best;
    // PROSAC: number of samples after which the next best pair is included.
    const bool is_ordered = static_cast<int>(pairs_.order.size()) == count;
    int among = is_ordered ? kSize : count;
    double expected = kUniformAfterSamples;  // number of samples from the best `among` pairs
    for (int k = 0; is_ordered && k < kSize; ++k)
      expected *= static_cast<double>(kSize - k) / static_cast<double>(count - k);
    int next_at = 1;
    int needed = options_.max_samples;
    std::array<int, kSize> sample{};
    for (int round = 1; round <= needed; ++round) {
      if (is_ordered && round > next_at && among < count) {
        const double next_expected = expected * (among + 1.0) / (among + 1.0 - kSize);
        next_at += std::max(1, static_cast<int>(std::ceil(next_expected - expected)));
        expected = next_expected;
        ++among;
      }
      draw(sample, among, is_ordered && round <= next_at && among < count);
      solve(sample, [&](const Matrix3d& matrix) {
        const double limit = effort_.refine_cost_ratio * best.cost;
        ScoredModel candidate = score(matrix, limit);
        if (candidate.cost >= limit) return;
        candidate = refined(candidate, refine, kMaxRefinements);
        if (candidate.cost >= best.cost) return;
        best = candidate;
        needed = std::min(needed, samples_for(best.inliers, kSize));
      });
    }
    if (best.inliers > 0) best = refined(best, refine, kMaxFinalRefinements);
    return best;
  }

  [[nodiscard]] std::vector<char> inliers_of(const Matrix3d& matrix) const {
    std::vector<double> errors(columns_.x.size());
    errors_(matrix, columns_, 0, columns_.count(), errors.data());
    std::vector<char> result(errors.size());
    for (std::size_t i = 0; i < errors.size(); ++i) result[i] = errors[i] <= squared_threshold_;
    return result;
  }

  [[nodiscard]] const Columns& columns() const { return columns_; }

 private:
  template <std::size_t kSize>
  void draw(std::array<int, kSize>& sample, int among, bool with_last) {
    for (std::size_t k = 0; k < kSize; ++k) {
      int pick = 0;
      bool is_new = false;
      while (!is_new) {
        pick = with_last && k == 0 ? among - 1 : rng_.integer(0, among - 1);
        is_new = std::find(sample.begin(), sample.begin() + static_cast<std::ptrdiff_t>(k), pick) ==
                 sample.begin() + static_cast<std::ptrdiff_t>(k);
      }
      sample[k] = pick;
    }
    if (pairs_.order.size() == columns_.x.size())
      for (int& i : sample) i = pairs_.order[at(i)];
  }

  // Stops where the cost exceeds `limit`.
  [[nodiscard]] ScoredModel score(const Matrix3d& matrix, double limit) const {
    constexpr int kBlock = 64;
    std::array<double, kBlock> errors;
    ScoredModel result{matrix, 0, 0};
    const double inverse = 1 / squared_threshold_;
    for (int from = 0; from < columns_.count(); from += kBlock) {
      const int to = std::min(columns_.count(), from + kBlock);
      errors_(matrix, columns_, from, to, errors.data());
      double sum = 0;
      int inside = 0;
      for (int i = 0; i < to - from; ++i) {
        const double share = errors[at(i)] * inverse;
        sum += share < 1 ? share : 1;
        inside += share <= 1 ? 1 : 0;
      }
      result.cost += sum;
      result.inliers += inside;
      if (result.cost >= limit) {
        result.cost = std::numeric_limits<double>::infinity();
        return result;
      }
    }
    return result;
  }

  template <typename Refine>
  [[nodiscard]] ScoredModel refined(ScoredModel best, const Refine& refine, int rounds) const {
    for (int k = 0; k < rounds; ++k) {
      const std::optional<Matrix3d> next = refine(best.matrix, inliers_of(best.matrix));
      if (!next) break;
      const ScoredModel candidate = score(*next, best.cost);
      if (candidate.cost >= best.cost * (1 - 1e-9)) break;
      best = candidate;
    }
    return best;
  }

  [[nodiscard]] int samples_for(int inliers, int size) const {
    const double share = static_cast<double>(inliers) / columns_.count();
    const double good = std::pow(share, size);
    const double samples = good < 1 ? std::log(1 - options_.confidence) / std::log1p(-good) : 0;
    return samples < options_.max_samples
               ? std::min(std::max(static_cast<int>(std::ceil(samples)), effort_.min_samples),
                          options_.max_samples)
               : options_.max_samples;
  }

  const PointPairs& pairs_;
  const RobustOptions& options_;
  Effort effort_;
  Columns columns_;
  Errors errors_;
  Rng rng_;
  double squared_threshold_ = 0;
};

template <std::size_t kSize>
std::array<Vector2d, kSize> chosen(const std::vector<Vector2d>& all,
                                   const std::array<int, kSize>& sample) {
  std::array<Vector2d, kSize> result;
  for (std::size_t k = 0; k < kSize; ++k) result[k] = all[at(sample[k])];
  return result;
}

// Number of inliers in front of both cameras.
int in_front(const geometry::Rigid3& motion, const PointPairs& pairs,
             const std::vector<char>& is_inlier) {
  int count = 0;
  for (std::size_t i = 0; i < is_inlier.size(); ++i) {
    if (is_inlier[i] == 0) continue;
    // z' x' = z R x + t, least squares for z and z'.
    const Vector3d a = motion.rotation * pairs.first[i].homogeneous();
    const Vector3d b = pairs.second[i].homogeneous();
    const double ab = a.dot(b);
    const double determinant = a.squaredNorm() * b.squaredNorm() - ab * ab;
    const double z = b.dot(motion.translation) * ab - a.dot(motion.translation) * b.squaredNorm();
    const double other =
        b.dot(motion.translation) * a.squaredNorm() - a.dot(motion.translation) * ab;
    count += determinant > 0 && z > 0 && other > 0 ? 1 : 0;
  }
  return count;
}

// normal += weight row row', lower triangle only.
template <int N>
void add_square(const Eigen::Matrix<double, N, 1>& row, double weight,
                Eigen::Matrix<double, N, N>& normal) {
  for (int j = 0; j < N; ++j) {
    const double factor = weight * row[j];
    for (int i = j; i < N; ++i) normal(i, j) += factor * row[i];
  }
}

// A Gauss-Newton step on Sampson's distances of the inliers, over the five parameters of a motion
// whose translation has length 1.
std::optional<geometry::Rigid3> gauss_newton_step(const geometry::Rigid3& motion, const Columns& c,
                                                  const std::vector<char>& is_inlier,
                                                  double squared_threshold) {
  const Matrix3d e = geometry::essential_of(motion);
  // Two directions perpendicular to the translation.
  const Vector3d& t = motion.translation;
  const Vector3d side = t.unitOrthogonal();
  const Vector3d up = t.cross(side);
  // The derivatives of E, row-major.
  Eigen::Matrix<double, 9, 5> slopes;
  for (int k = 0; k < 3; ++k) {
    const Vector3d axis = Vector3d::Unit(k);
    Matrix3d turned;
    for (int j = 0; j < 3; ++j) turned.col(j) = axis.cross(motion.rotation.col(j));
    const RowMajor3 d = geometry::essential_of({turned, t});
    slopes.col(k) = Eigen::Map<const Vector9>(d.data());
  }
  const RowMajor3 by_side = geometry::essential_of({motion.rotation, side});
  const RowMajor3 by_up = geometry::essential_of({motion.rotation, up});
  slopes.col(3) = Eigen::Map<const Vector9>(by_side.data());
  slopes.col(4) = Eigen::Map<const Vector9>(by_up.data());

  Eigen::Matrix<double, 5, 5> normal = Eigen::Matrix<double, 5, 5>::Zero();
  Vector5 right = Vector5::Zero();
  for (std::size_t i = 0; i < is_inlier.size(); ++i) {
    if (is_inlier[i] == 0) continue;
    const Vector3d a(c.x[i], c.y[i], 1);
    const Vector3d b(c.u[i], c.v[i], 1);
    const Vector3d line = e * a;
    const Vector3d other = e.transpose() * b;
    const double algebraic_error = b.dot(line);
    const double square = line.head<2>().squaredNorm() + other.head<2>().squaredNorm();
    if (!(square > 0)) continue;
    const double inverse = 1 / std::sqrt(square);
    const double residual = algebraic_error * inverse;
    Vector9 slope;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        const double by_square =
            (row < 2 ? line[row] * a[column] : 0) + (column < 2 ? other[column] * b[row] : 0);
        slope[3 * row + column] = inverse * (b[row] * a[column] - residual * inverse * by_square);
      }
    }
    const double weight = 1 / (1 + residual * residual / (0.25 * squared_threshold));  // Cauchy
    Vector5 by_motion;
    for (int k = 0; k < 5; ++k) by_motion[k] = slopes.col(k).dot(slope);
    add_square(by_motion, weight, normal);
    right += weight * residual * by_motion;
  }
  const linalg::Cholesky factor(normal);
  if (!factor.ok()) return std::nullopt;
  const Vector5 step = -factor.solve(right);
  if (!step.allFinite() || step.norm() > 1) return std::nullopt;
  geometry::Rigid3 next;
  next.rotation = geometry::rotation_by(step.head<3>()) * motion.rotation;
  next.translation = (t + step[3] * side + step[4] * up).normalized();
  return next;
}

// The 3 x 3 matrix whose nine numbers minimise the sum of squares of linear equations, from the
// lower triangle of their normal matrix; empty where that is not finite.
std::optional<Matrix3d> smallest_eigenvector_matrix(const Eigen::Matrix<double, 9, 9>& normal) {
  if (!normal.allFinite()) return std::nullopt;
  const Vector9 rows = linalg::symmetric_eigen(normal).vectors.col(0);
  return Matrix3d(Eigen::Map<const RowMajor3>(rows.data()));
}

// Transforms points to mean 0 and mean distance sqrt 2 (Hartley, PAMI 1997).
Matrix3d normalizer(const std::vector<Vector2d>& points) {
  Vector2d mean = Vector2d::Zero();
  for (const Vector2d& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  double distance = 0;
  for (const Vector2d& p : points) distance += (p - mean).norm();
  const double scale =
      distance > 0 ? std::sqrt(2.0) * static_cast<double>(points.size()) / distance : 1;
  Matrix3d m;
  m << scale, 0, -scale * mean[0], 0, scale, -scale * mean[1], 0, 0, 1;
  return m;
}

std::vector<Vector2d> moved(const std::vector<Vector2d>& points, const Matrix3d& by) {
  std::vector<Vector2d> result;
  result.reserve(points.size());
  for (const Vector2d& p : points)
    result.emplace_back(by(0, 0) * p[0] + by(0, 2), by(1, 1) * p[1] + by(1, 2));
  return result;
}

void check(const PointPairs& pairs, const RobustOptions& options) {
  TARSIER_REQUIRE(pairs.first.size() == pairs.second.size() &&
                      (pairs.order.empty() || pairs.order.size() == pairs.first.size()),
                  "{} points in one image, {} in the other, {} in the order", pairs.first.size(),
                  pairs.second.size(), pairs.order.size());
  options.check();
}

RobustMatrix finished(const Ransac& ransac, const ScoredModel& best) {
  RobustMatrix result;
  if (best.inliers == 0) return result;
  result.matrix = best.matrix;
  result.is_inlier = ransac.inliers_of(best.matrix);
  result.inliers = best.inliers;
  return result;
}

}  // namespace

RobustMotion robust_motion(const PointPairs& pairs, const RobustOptions& options) {
  check(pairs, options);
  Ransac ransac(pairs, options, sampson, kMotionEffort);
  const double squared = options.threshold * options.threshold;
  const auto solve = [&](const std::array<int, 5>& sample, const auto& offer) {
    std::array<Matrix3d, geometry::kMaxEssentials> essentials;
    const int count =
        geometry::five_point(chosen(pairs.first, sample), chosen(pairs.second, sample), essentials);
    for (int k = 0; k < count; ++k) offer(essentials[at(k)]);
  };
  const auto motion_of = [&](const Matrix3d& essential, const std::vector<char>& is_inlier) {
    std::optional<geometry::Rigid3> best;
    int max_in_front = -1;
    for (const geometry::Rigid3& motion : geometry::motions_of(essential)) {
      const int count = in_front(motion, pairs, is_inlier);
      if (count > max_in_front) {
        max_in_front = count;
        best = motion;
      }
    }
    return best;
  };
  const auto refine = [&](const Matrix3d& essential,
                          const std::vector<char>& is_inlier) -> std::optional<Matrix3d> {
    const auto next =
        gauss_newton_step(geometry::motions_of(essential)[0], ransac.columns(), is_inlier, squared);
    if (!next) return std::nullopt;
    const Matrix3d e = geometry::essential_of(*next);
    return Matrix3d(e / e.norm());
  };
  const ScoredModel best = ransac.run<5>(solve, refine);
  RobustMotion result;
  if (best.inliers == 0) return result;
  result.is_inlier = ransac.inliers_of(best.matrix);
  result.inliers = best.inliers;
  result.second_from_first = *motion_of(best.matrix, result.is_inlier);
  return result;
}

RefinedMotion refine_motion(const PointPairs& pairs, const geometry::Rigid3& start,
                            double threshold, int max_steps) {
  const Columns columns(pairs);
  const std::vector<char> all(columns.x.size(), 1);
  std::vector<double> squares(columns.x.size());
  const double scale = 4 / (threshold * threshold);
  const auto cost_of = [&](const geometry::Rigid3& motion) {
    sampson(geometry::essential_of(motion), columns, 0, columns.count(), squares.data());
    double cost = 0;
    for (const double square : squares) cost += std::log1p(scale * square);
    return cost;
  };
  RefinedMotion best{start, cost_of(start)};
  for (int k = 0; k < max_steps; ++k) {
    const auto next =
        gauss_newton_step(best.second_from_first, columns, all, threshold * threshold);
    if (!next) break;
    const double cost = cost_of(*next);
    if (!(cost < best.cost)) break;
    const bool is_done = cost > best.cost * (1 - 1e-4);
    best = {*next, cost};
    if (is_done) break;
  }
  return best;
}

RobustMatrix robust_fundamental(const PointPairs& pairs, const RobustOptions& options) {
  check(pairs, options);
  if (pairs.first.size() < 7) return {};
  Ransac ransac(pairs, options, sampson);
  const Matrix3d to_first = normalizer(pairs.first);
  const Matrix3d to_second = normalizer(pairs.second);
  const std::vector<Vector2d> first = moved(pairs.first, to_first);
  const std::vector<Vector2d> second = moved(pairs.second, to_second);
  const auto back = [&](const Matrix3d& f) {
    const Matrix3d result = to_second.transpose() * f * to_first;
    return Matrix3d(result / result.norm());
  };
  const auto solve = [&](const std::array<int, 7>& sample, const auto& offer) {
    std::array<Matrix3d, geometry::kMaxFundamentals> found;
    const int count = geometry::seven_point(chosen(first, sample), chosen(second, sample), found);
    for (int k = 0; k < count; ++k) offer(back(found[at(k)]));
  };
  // The eight-point method, each equation divided by the previous Sampson denominator.
  const auto refine = [&](const Matrix3d& f,
                          const std::vector<char>& is_inlier) -> std::optional<Matrix3d> {
    Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
    int used_inliers = 0;
    for (std::size_t i = 0; i < is_inlier.size(); ++i) {
      if (is_inlier[i] == 0) continue;
      const Vector3d line = f * pairs.first[i].homogeneous();
      const Vector3d other = f.transpose() * pairs.second[i].homogeneous();
      const double square = line.head<2>().squaredNorm() + other.head<2>().squaredNorm();
      if (!(square > 0)) continue;
      const Vector3d a = first[i].homogeneous();
      const Vector3d b = second[i].homogeneous();
      Vector9 row;
      row << b[0] * a, b[1] * a, a;
      add_square(row, 1 / square, normal);
      ++used_inliers;
    }
    if (used_inliers < 8) return std::nullopt;
    const std::optional<Matrix3d> full = smallest_eigenvector_matrix(normal);
    if (!full) return std::nullopt;
    // The nearest matrix of rank 2: without the direction v of the smallest singular value.
    const Matrix3d squared = full->transpose() * *full;
    const Vector3d v = linalg::symmetric_eigen(squared).vectors.col(0);
    const Matrix3d rank_2 = *full - *full * v * v.transpose();
    return rank_2.allFinite() ? std::optional(back(rank_2)) : std::nullopt;
  };
  return finished(ransac, ransac.run<7>(solve, refine));
}

RobustMatrix robust_homography(const PointPairs& pairs, const RobustOptions& options) {
  check(pairs, options);
  if (pairs.first.size() < 4) return {};
  Ransac ransac(pairs, options, transfer);
  const Matrix3d to_first = normalizer(pairs.first);
  const Matrix3d to_second = normalizer(pairs.second);
  const std::vector<Vector2d> first = moved(pairs.first, to_first);
  const std::vector<Vector2d> second = moved(pairs.second, to_second);
  const Matrix3d from_second = to_second.inverse();
  const auto back = [&](const Matrix3d& h) {
    const Matrix3d result = from_second * h * to_first;
    return Matrix3d(result / result.norm());
  };
  const auto solve = [&](const std::array<int, 4>& sample, const auto& offer) {
    Matrix3d h;
    if (geometry::four_point(chosen(first, sample), chosen(second, sample), h)) offer(back(h));
  };
  const auto refine = [&](const Matrix3d&,
                          const std::vector<char>& is_inlier) -> std::optional<Matrix3d> {
    Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
    int used_inliers = 0;
    for (std::size_t i = 0; i < is_inlier.size(); ++i) {
      if (is_inlier[i] == 0) continue;
      const Vector3d a = first[i].homogeneous();
      Vector9 row;
      row << a, Vector3d::Zero(), -second[i][0] * a;
      add_square(row, 1, normal);
      row << Vector3d::Zero(), a, -second[i][1] * a;
      add_square(row, 1, normal);
      ++used_inliers;
    }
    if (used_inliers < 4) return std::nullopt;
    const std::optional<Matrix3d> h = smallest_eigenvector_matrix(normal);
    return h ? std::optional(back(*h)) : std::nullopt;
  };
  return finished(ransac, ransac.run<4>(solve, refine));
}

}  // namespace tarsier::sfm
