// SPDX-License-Identifier: MIT
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_trainer.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace tarsier::face::head {

using Eigen::Index;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

void HeadTrainer::update_visibility(TrainingView& view) const {
  const double yaw = angles_of_rotation(view.camera.rotation).yaw_deg;
  const double far = std::exp(-0.5 * std::pow(yaw / options.outline_yaw_deg, 2));
  for (Index i = 0; i < n; ++i) {
    const bool hidden = is_outline[static_cast<std::size_t>(i)] != 0 && mean(0, i) * yaw < 0;
    view.visible[i] = hidden ? far : 1;
  }
}

void HeadTrainer::estimate(TrainingView& view, int steps) const {
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

}  // namespace tarsier::face::head
