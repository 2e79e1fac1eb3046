// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/lens_fit.h"

#include "tarsier/core/stop.h"
#include "tarsier/geometry/planar_pose.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace tarsier::planar::calibration {
namespace {

using geometry::Camera;
using geometry::Lens;
using geometry::Rigid3;
using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic>;

constexpr double kBehind = 1e3;  // px, residual of a point behind the camera

double& number(Camera& camera, int index) {
  switch (index) {
    case 0:
      return camera.fx;
    case 1:
      return camera.fy;
    case 2:
      return camera.cx;
    case 3:
      return camera.cy;
    default:
      return camera.distortion[static_cast<std::size_t>(index - 4)];
  }
}

std::vector<bool> moving(const Camera& camera, const FitOptions& options) {
  std::vector<bool> moves(static_cast<std::size_t>(parameter_count(camera)), true);
  if (options.fix_aspect) moves[1] = false;  // equals fx
  if (options.fix_center) moves[2] = moves[3] = false;
  const auto keep = [&](std::size_t k) { moves[4 + k] = false; };
  if (camera.lens == Lens::kFisheye) {
    for (int k = std::max(0, options.radial); k < 4; ++k) keep(static_cast<std::size_t>(k));
    return moves;
  }
  if (options.fix_tangential) {
    keep(2);
    keep(3);
  }
  if (camera.lens == Lens::kRational) return moves;
  constexpr std::array<std::size_t, 3> kRadial{0, 1, 4};
  for (int k = std::max(0, options.radial); k < 3; ++k) keep(kRadial[static_cast<std::size_t>(k)]);
  return moves;
}

// Applies the rotation vector and the translation to the pose.
Rigid3 moved(const Rigid3& pose, const Eigen::Matrix<double, 6, 1>& step) {
  return {geometry::rotation_by(step.head<3>()) * pose.rotation, pose.translation + step.tail<3>()};
}

cv::Point2d residual(const Camera& camera, const Rigid3& pose, const cv::Point2d& board,
                     const cv::Point2d& pixel) {
  const auto seen = board_pixel(camera, pose, board);
  if (!seen || !std::isfinite(seen->x) || !std::isfinite(seen->y)) return {kBehind, kBehind};
  return *seen - pixel;
}

// Huber's loss: from the squared distance to the cost and the weight of the square.
struct Loss {
  double scale;
  [[nodiscard]] double cost(double squared) const {
    const double d = std::sqrt(squared);
    return scale <= 0 || d <= scale ? squared : scale * (2 * d - scale);
  }
  [[nodiscard]] double weight(double squared) const {
    const double d = std::sqrt(squared);
    return scale <= 0 || d <= scale ? 1 : scale / d;
  }
};

double cost_of(const Camera& camera, const std::vector<FitView>& views, const Loss& loss) {
  double sum = 0;
  for (const FitView& view : views) {
    if (!view.used) continue;
    for (std::size_t i = 0; i < view.board.size(); ++i) {
      const cv::Point2d r = residual(camera, view.camera_from_board, view.board[i], view.pixels[i]);
      sum += loss.cost(r.dot(r));
    }
  }
  return sum;
}

// The normal equations of one view.
struct ViewEquations {
  Block lens;                         // A^T A
  Block cross;                        // A^T B
  Eigen::Matrix<double, 6, 6> pose;   // B^T B
  Eigen::VectorXd lens_right;         // A^T r
  Eigen::Matrix<double, 6, 1> right;  // B^T r
};

class Derivatives {
 public:
  Derivatives(const Camera& camera, const std::vector<bool>& moves, bool tied)
      : camera_(camera), moves_(moves) {
    const auto count = static_cast<int>(moves.size());
    for (int k = 0; k < count; ++k) {
      const double step = k < 4 ? 1e-5 * camera.fx : 1e-5;
      Camera more = camera;
      Camera less = camera;
      number(more, k) += step;
      number(less, k) -= step;
      if (tied && k == 0) {
        more.fy += step;
        less.fy -= step;
      }
      more_.push_back(more);
      less_.push_back(less);
      steps_.push_back(step);
    }
  }

  [[nodiscard]] ViewEquations of(const FitView& view, const Loss& loss) const {
    const auto n = static_cast<Eigen::Index>(moves_.size());
    ViewEquations e{Block::Zero(n, n), Block::Zero(n, 6), Eigen::Matrix<double, 6, 6>::Zero(),
                    Eigen::VectorXd::Zero(n), Eigen::Matrix<double, 6, 1>::Zero()};
    const Rigid3& pose = view.camera_from_board;
    const double length = 1e-6 * pose.translation.norm();
    std::array<Rigid3, 12> around;
    for (int k = 0; k < 6; ++k) {
      Eigen::Matrix<double, 6, 1> step = Eigen::Matrix<double, 6, 1>::Zero();
      step[k] = k < 3 ? 1e-6 : length;
      around[static_cast<std::size_t>(2 * k)] = moved(pose, step);
      around[static_cast<std::size_t>(2 * k + 1)] = moved(pose, -step);
    }
    Eigen::Matrix<double, 2, Eigen::Dynamic> a(2, n);
    Eigen::Matrix<double, 2, 6> b;
    for (std::size_t i = 0; i < view.board.size(); ++i) {
      const cv::Point2d& board = view.board[i];
      const cv::Point2d& pixel = view.pixels[i];
      const cv::Point2d r = residual(camera_, pose, board, pixel);
      for (int k = 0; k < 6; ++k) {
        const cv::Point2d d =
            residual(camera_, around[static_cast<std::size_t>(2 * k)], board, pixel) -
            residual(camera_, around[static_cast<std::size_t>(2 * k + 1)], board, pixel);
        const double step = 2 * (k < 3 ? 1e-6 : length);
        b.col(k) << d.x / step, d.y / step;
      }
      for (Eigen::Index k = 0; k < n; ++k) {
        const auto c = static_cast<std::size_t>(k);
        if (!moves_[c]) {
          a.col(k).setZero();
          continue;
        }
        const cv::Point2d d =
            residual(more_[c], pose, board, pixel) - residual(less_[c], pose, board, pixel);
        a.col(k) << d.x / (2 * steps_[c]), d.y / (2 * steps_[c]);
      }
      const double w = loss.weight(r.dot(r));
      const Eigen::Vector2d error(r.x, r.y);
      e.lens += w * a.transpose() * a;
      e.cross += w * a.transpose() * b;
      e.pose += w * b.transpose() * b;
      e.lens_right += w * a.transpose() * error;
      e.right += w * b.transpose() * error;
    }
    return e;
  }

 private:
  Camera camera_;
  std::vector<bool> moves_;
  std::vector<Camera> more_;
  std::vector<Camera> less_;
  std::vector<double> steps_;
};

// The equations of all views with their poses eliminated: S x = right.
struct ReducedEquations {
  Block s;
  Eigen::VectorXd right;
};

Eigen::Matrix<double, 6, 6> damped(const Eigen::Matrix<double, 6, 6>& block, double damping) {
  Eigen::Matrix<double, 6, 6> result = block;
  for (int k = 0; k < 6; ++k) result(k, k) += damping * block(k, k) + 1e-12;
  return result;
}

ReducedEquations reduce(const std::vector<ViewEquations>& all, Eigen::Index n, double damping) {
  ReducedEquations r{Block::Zero(n, n), Eigen::VectorXd::Zero(n)};
  for (const ViewEquations& e : all) {
    r.s += e.lens;
    r.right += e.lens_right;
  }
  for (Eigen::Index k = 0; k < n; ++k) r.s(k, k) += damping * r.s(k, k);
  for (const ViewEquations& e : all) {
    Eigen::MatrixXd sides(6, n + 1);  // right-hand sides: of the lens, and of the gradient
    sides << e.cross.transpose(), e.right;
    const Eigen::MatrixXd solved = linalg::solve_symmetric(damped(e.pose, damping), sides);
    r.s -= e.cross * solved.leftCols(n);
    r.right -= e.cross * solved.col(n);
  }
  return r;
}

bool is_possible(const Camera& camera) {
  const double larger = std::max(camera.width, camera.height);
  const auto f_fits = [&](double f) { return f > 0.02 * larger && f < 200 * larger; };
  return f_fits(camera.fx) && f_fits(camera.fy) && std::abs(camera.cx) < 10 * larger &&
         std::abs(camera.cy) < 10 * larger;
}

}  // namespace

int parameter_count(const Camera& camera) {
  return 4 + static_cast<int>(camera.coefficients().size());
}

std::optional<cv::Point2d> board_pixel(const Camera& camera, const Rigid3& camera_from_board,
                                       const cv::Point2d& point) {
  return camera.project(camera_from_board * Eigen::Vector3d(point.x, point.y, 0));
}

double rms_of(const Camera& camera, const FitView& view) {
  double sum = 0;
  for (std::size_t i = 0; i < view.board.size(); ++i) {
    const cv::Point2d r = residual(camera, view.camera_from_board, view.board[i], view.pixels[i]);
    sum += r.dot(r);
  }
  return view.board.empty() ? 0 : std::sqrt(sum / static_cast<double>(view.board.size()));
}

FitResult fit_lens(Camera& camera, std::vector<FitView>& views, const FitOptions& options,
                   const std::stop_token& stop) {
  const std::vector<bool> moves = moving(camera, options);
  const auto n = static_cast<Eigen::Index>(moves.size());
  const Loss loss{options.loss_px};
  FitResult result;
  result.cost = cost_of(camera, views, loss);
  double damping = 1e-3;
  std::vector<ViewEquations> equations;
  bool is_fresh = false;
  for (int step = 0; step < options.max_steps && !result.converged; ++step) {
    throw_if_stopped(stop);
    if (!is_fresh) {
      equations.clear();
      const Derivatives derivatives(camera, moves, options.fix_aspect);
      for (const FitView& view : views)
        if (view.used) equations.push_back(derivatives.of(view, loss));
      is_fresh = true;
    }
    const ReducedEquations reduced = reduce(equations, n, damping);
    Block s = reduced.s;
    for (Eigen::Index k = 0; k < n; ++k)
      if (!moves[static_cast<std::size_t>(k)]) s(k, k) = 1;
    const Eigen::VectorXd change = -linalg::solve_symmetric(s, reduced.right);
    Camera next = camera;
    std::vector<FitView> next_views = views;
    bool is_finite = change.allFinite();
    for (Eigen::Index k = 0; k < n && is_finite; ++k)
      if (moves[static_cast<std::size_t>(k)]) number(next, static_cast<int>(k)) += change[k];
    if (options.fix_aspect) next.fy = next.fx;
    std::size_t at = 0;
    for (FitView& view : next_views) {
      if (!view.used) continue;
      const ViewEquations& e = equations[at++];
      const Eigen::Matrix<double, 6, 1> turn =
          -linalg::solve_symmetric(damped(e.pose, damping), e.right + e.cross.transpose() * change);
      is_finite = is_finite && turn.allFinite();
      if (is_finite) view.camera_from_board = moved(view.camera_from_board, turn);
    }
    const double cost = is_finite && is_possible(next) ? cost_of(next, next_views, loss)
                                                       : std::numeric_limits<double>::infinity();
    if (cost < result.cost) {
      result.converged = result.cost - cost <= 1e-12 * result.cost;
      camera = next;
      views = std::move(next_views);
      result.cost = cost;
      damping = std::max(1e-12, 0.2 * damping);
      is_fresh = false;
    } else {
      damping *= 8;
      result.converged = damping > 1e8;  // no step reduces the cost: rounding
    }
  }
  // Equations without loss and damping, at the solution.
  equations.clear();
  const Derivatives derivatives(camera, moves, options.fix_aspect);
  for (const FitView& view : views)
    if (view.used) equations.push_back(derivatives.of(view, Loss{0}));
  result.information = reduce(equations, n, 0).s;
  return result;
}

std::optional<Rigid3> start_pose(const Camera& camera, const FitView& view) {
  std::vector<cv::Point2d> board;
  std::vector<cv::Point2d> rays;
  for (std::size_t i = 0; i < view.board.size(); ++i) {
    const auto ray = camera.normalized_of(view.pixels[i]);
    // Rays far from the axis would dominate on the plane.
    if (!ray || cv::norm(*ray) > 8) continue;
    board.push_back(view.board[i]);
    rays.push_back(*ray);
  }
  Camera plain;  // its pixels are the rays
  plain.fx = plain.fy = 1;
  plain.cx = plain.cy = 0;
  geometry::PlanarPoseOptions closed_form;
  closed_form.iterations = 0;
  const auto poses = geometry::planar_poses(board, rays, plain, closed_form);
  if (!poses) return std::nullopt;
  return poses->best.camera_from_plane;
}

}  // namespace tarsier::planar::calibration
