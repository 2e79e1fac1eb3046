// SPDX-License-Identifier: MIT
#include "tarsier/face/head/posit_solver.h"

#include "tarsier/geometry/refine_pose.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>

namespace tarsier::face::head {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

constexpr const char* kBehindCamera = "the points come out behind the camera";
constexpr const char* kNoScale = "the points of the image coincide";

// inverse' * v, and 1 + points * forward, without allocation.
Vector3d times(const Eigen::MatrixX3d& inverse, const Eigen::VectorXd& v) {
  return {inverse.col(0).dot(v), inverse.col(1).dot(v), inverse.col(2).dot(v)};
}

void depths(const Eigen::MatrixX3d& points, const Vector3d& forward, Eigen::VectorXd& w) {
  w = (points.col(0) * forward[0] + points.col(1) * forward[1] + points.col(2) * forward[2])
          .array() +
      1;
}

// The rotation whose first two rows are equally near to the directions of both vectors.
bool rotation_of_rows(const Vector3d& first, const Vector3d& second, Matrix3d& rotation) {
  const double a = first.norm();
  const double b = second.norm();
  if (!(a > 0) || !(b > 0)) return false;
  Vector3d sum = first / a + second / b;
  Vector3d difference = first / a - second / b;
  const double c = sum.norm();
  const double d = difference.norm();
  if (!(c > 1e-9) || !(d > 1e-9)) return false;
  sum /= c * std::sqrt(2.0);
  difference /= d * std::sqrt(2.0);
  rotation.row(0) = sum + difference;
  rotation.row(1) = sum - difference;
  rotation.row(2) = rotation.row(0).cross(rotation.row(1));
  return true;
}

}  // namespace

bool PositSolver::update_depths(State& state) {
  const double change = (space.wx - space.w).cwiseAbs().maxCoeff();
  space.w.swap(space.wx);
  state.converged = change < options.tolerance;
  return state.converged;
}

PositResult PositSolver::homogeneous() {
  State state{Matrix3d::Identity(), Vector3d::Zero()};
  const auto n = static_cast<double>(space.x.size());
  while (state.iterations < options.max_iterations) {
    ++state.iterations;
    space.wx = space.w.cwiseProduct(space.x);
    space.wy = space.w.cwiseProduct(space.y);
    const Vector3d first = times(model.inverse_, space.wx);
    const Vector3d second = times(model.inverse_, space.wy);
    const double scale = std::sqrt(first.norm() * second.norm());
    if (!(scale > 0) || !rotation_of_rows(first, second, state.rotation))
      return {std::nullopt, kNoScale};
    state.translation << model.weights_.dot(space.wx) / n / scale,
        model.weights_.dot(space.wy) / n / scale, 1 / scale;
    const Vector3d forward = scale * state.rotation.row(2).transpose();
    depths(model.from_centroid_, forward, space.wx);
    if (update_depths(state)) break;
  }
  return finish(state, options.refine_steps);
}

PositResult PositSolver::classic() {
  State state{Matrix3d::Identity(), Vector3d::Zero()};
  const double x0 = space.x[model.reference_];
  const double y0 = space.y[model.reference_];
  while (state.iterations < options.max_iterations) {
    ++state.iterations;
    space.wx = (space.w.array() * space.x.array() - x0).matrix();
    space.wy = (space.w.array() * space.y.array() - y0).matrix();
    const Vector3d first = times(model.reference_inverse_, space.wx);
    const Vector3d second = times(model.reference_inverse_, space.wy);
    const double scale = std::sqrt(first.norm() * second.norm());
    if (!(scale > 0)) return {std::nullopt, kNoScale};
    // As published: the first row is kept, the third is normal to both, the second follows from
    // them.
    state.rotation.row(0) = first.normalized();
    const Vector3d third = first.cross(second);
    if (!(third.norm() > 0)) return {std::nullopt, kNoScale};
    state.rotation.row(2) = third.normalized();
    state.rotation.row(1) = state.rotation.row(2).cross(state.rotation.row(0));
    const Vector3d at_reference(x0 / scale, y0 / scale, 1 / scale);
    state.translation = at_reference + state.rotation * (model.centroid_ - model.reference_point_);
    depths(model.from_reference_, scale * state.rotation.row(2).transpose(), space.wx);
    if (update_depths(state)) break;
  }
  return finish(state, options.refine_steps);
}

double PositSolver::cost(const Matrix3d& rotation, const Vector3d& translation) const {
  double sum = 0;
  double nearest = std::numeric_limits<double>::infinity();
  for (Index i = 0; i < space.x.size(); ++i) {
    const double a = model.from_centroid_(i, 0);
    const double b = model.from_centroid_(i, 1);
    const double c = model.from_centroid_(i, 2);
    const double z = rotation(2, 0) * a + rotation(2, 1) * b + rotation(2, 2) * c + translation[2];
    const double x = rotation(0, 0) * a + rotation(0, 1) * b + rotation(0, 2) * c + translation[0];
    const double y = rotation(1, 0) * a + rotation(1, 1) * b + rotation(1, 2) * c + translation[1];
    const double inverse = 1 / z;
    const double u = x * inverse - space.x[i];
    const double v = y * inverse - space.y[i];
    sum += model.weights_[i] * (u * u + v * v);
    nearest = std::min(nearest, z);
  }
  return nearest > 0 && std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
}

// Residual r = projection - measured; a small rotation w moves q = R p by w x q: du = ((w x q)_x +
// dt_x - u ((w x q)_z + dt_z)) / z, dv likewise.
void PositSolver::refine(State& state, int steps) const {
  const auto equations = [this](const Matrix3d& rotation, const Vector3d& translation) {
    geometry::PoseEquations sums;
    auto& [normal, gradient] = sums;
    // Sums over the rows of u: h(0..5), and of v likewise with its own zero; only the lower
    // triangle.
    for (Index i = 0; i < space.x.size(); ++i) {
      const Vector3d q = rotation * model.from_centroid_.row(i).transpose();
      const double inverse = 1 / (q[2] + translation[2]);
      const double u = (q[0] + translation[0]) * inverse;
      const double v = (q[1] + translation[1]) * inverse;
      const double weight = model.weights_[i];
      const double scale = weight * inverse * inverse;
      const double a0 = -u * q[1], a1 = q[2] + u * q[0], a2 = -q[1];
      const double b0 = -q[2] - v * q[1], b1 = v * q[0], b2 = q[0];
      normal(0, 0) += scale * (a0 * a0 + b0 * b0);
      normal(1, 0) += scale * (a1 * a0 + b1 * b0);
      normal(1, 1) += scale * (a1 * a1 + b1 * b1);
      normal(2, 0) += scale * (a2 * a0 + b2 * b0);
      normal(2, 1) += scale * (a2 * a1 + b2 * b1);
      normal(2, 2) += scale * (a2 * a2 + b2 * b2);
      normal(3, 0) += scale * a0;
      normal(3, 1) += scale * a1;
      normal(3, 2) += scale * a2;
      normal(3, 3) += scale;
      normal(4, 0) += scale * b0;
      normal(4, 1) += scale * b1;
      normal(4, 2) += scale * b2;
      normal(5, 0) -= scale * (u * a0 + v * b0);
      normal(5, 1) -= scale * (u * a1 + v * b1);
      normal(5, 2) -= scale * (u * a2 + v * b2);
      normal(5, 3) -= scale * u;
      normal(5, 4) -= scale * v;
      normal(5, 5) += scale * (u * u + v * v);
      const double ru = weight * inverse * (u - space.x[i]);
      const double rv = weight * inverse * (v - space.y[i]);
      gradient[0] += a0 * ru + b0 * rv;
      gradient[1] += a1 * ru + b1 * rv;
      gradient[2] += a2 * ru + b2 * rv;
      gradient[3] += ru;
      gradient[4] += rv;
      gradient[5] -= u * ru + v * rv;
    }
    normal(4, 4) = normal(3, 3);
    return sums;
  };
  const auto cost_of = [this](const Matrix3d& rotation, const Vector3d& translation) {
    return cost(rotation, translation);
  };
  const geometry::RefinePoseOptions how{.max_steps = steps};
  if (geometry::refine_pose(state.rotation, state.translation, cost_of, equations, how).converged)
    state.converged = true;
}

PositResult PositSolver::finish(State& state, int refine_steps) const {
  // A diverged solution is not a rotation.
  const Matrix3d square = state.rotation * state.rotation.transpose();
  if (!state.translation.allFinite() || !((square - Matrix3d::Identity()).norm() < 1e-6))
    return {std::nullopt, "the iteration does not come to an end"};
  if (refine_steps > 0) refine(state, refine_steps);
  const double sum = cost(state.rotation, state.translation);
  if (!std::isfinite(sum)) return {std::nullopt, kBehindCamera};
  PositPose pose;
  const Vector3d translation = state.translation - state.rotation * model.centroid_;
  for (int r = 0; r < 3; ++r) {
    pose.camera_from_object.translation[r] = translation[r];
    for (int c = 0; c < 3; ++c) pose.camera_from_object.rotation(r, c) = state.rotation(r, c);
  }
  pose.rms = std::sqrt(sum / static_cast<double>(space.x.size()));
  pose.iterations = state.iterations;
  pose.converged = state.converged;
  return {pose, ""};
}

// Within the plane the rows I0 and J0 are known. Along its normal they are lambda and mu with
// (lambda + i mu)^2 = J0^2 - I0^2 - 2 i I0.J0, so that I.J = 0 and |I| = |J|: two signs.
PositResult PositSolver::planar_branch(double sign) {
  State state{Matrix3d::Identity(), Vector3d::Zero()};
  const auto n = static_cast<double>(space.x.size());
  space.w.setOnes();
  Vector3d before = Vector3d::Zero();  // the previous third row
  while (state.iterations < options.max_iterations) {
    ++state.iterations;
    space.wx = space.w.cwiseProduct(space.x);
    space.wy = space.w.cwiseProduct(space.y);
    const Vector3d flat_first = times(model.planar_inverse_, space.wx);
    const Vector3d flat_second = times(model.planar_inverse_, space.wy);
    const std::complex<double> root = std::sqrt(std::complex<double>(
        flat_second.squaredNorm() - flat_first.squaredNorm(), -2 * flat_first.dot(flat_second)));
    double best = -std::numeric_limits<double>::infinity();
    Matrix3d chosen = Matrix3d::Identity();
    double scale = 0;
    for (const double side : {1.0, -1.0}) {
      // The first iteration uses the branch's sign; later ones use the sign nearest to the previous
      // result.
      if (state.iterations == 1 && side != sign) continue;
      const Vector3d first = flat_first + side * root.real() * model.normal_;
      const Vector3d second = flat_second + side * root.imag() * model.normal_;
      Matrix3d rotation;
      if (!rotation_of_rows(first, second, rotation)) continue;
      const double likeness = rotation.row(2).dot(before);
      if (likeness > best) {
        best = likeness;
        chosen = rotation;
        scale = std::sqrt(first.norm() * second.norm());
      }
    }
    if (!(scale > 0)) return {std::nullopt, kNoScale};
    state.rotation = chosen;
    before = chosen.row(2);
    state.translation << model.weights_.dot(space.wx) / n / scale,
        model.weights_.dot(space.wy) / n / scale, 1 / scale;
    depths(model.from_centroid_, scale * state.rotation.row(2).transpose(), space.wx);
    if (update_depths(state)) break;
  }
  return finish(state, std::max(options.refine_steps, 10));
}

PlanarPositResult PositSolver::planar() {
  PlanarPositResult result;
  std::array<PositResult, 3> found = {planar_branch(1), planar_branch(-1), PositResult{}};
  if (!found[0].pose && !found[1].pose) {
    result.reason = found[0].reason;
    return result;
  }
  const auto best_of = [&]() -> const PositPose* {
    const PositPose* best = nullptr;
    for (const PositResult& one : found) {
      if (one.pose && (best == nullptr || one.pose->rms < best->rms)) best = &*one.pose;
    }
    return best;
  };
  // From far away, a plane looks the same when mirrored in depth. If both branches converged to one
  // pose, this gives the other one: R' = (I - 2 v v') R (I - 2 u u'), v the view, u the normal.
  const geometry::Rigid3& known = best_of()->camera_from_object;
  State state{known.rotation, known * model.centroid_};
  const Vector3d view = state.translation.normalized();
  const Matrix3d in_depth = Matrix3d::Identity() - 2 * view * view.transpose();
  const Matrix3d of_plane = Matrix3d::Identity() - 2 * model.normal_ * model.normal_.transpose();
  state.rotation = in_depth * state.rotation * of_plane;
  found[2] = finish(state, std::max(options.refine_steps, 20));

  result.poses[0] = *best_of();
  for (PositResult& one : found) {
    if (!one.pose) continue;
    const Eigen::Matrix3d between = result.poses[0]->camera_from_object.rotation *
                                    one.pose->camera_from_object.rotation.transpose();
    if (geometry::angle_of(between) < 1e-3) one.pose.reset();
  }
  if (const PositPose* second = best_of()) result.poses[1] = *second;
  return result;
}

}  // namespace tarsier::face::head
