// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_trainer.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace tarsier::face::head {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

void HeadTrainer::start() {
  std::vector<Matrix2Xd> faces;
  faces.reserve(views.size());
  for (const TrainingView& view : views) faces.push_back(view.points);
  const auto rigid = factorize_symmetric(faces, markup.mirror);
  TARSIER_REQUIRE(rigid.has_value(),
                  "the faces must turn: these {} do not determine the depth of their points",
                  faces.size());
  mean = rigid->shape;
  for (std::size_t f = 0; f < views.size(); ++f) views[f].camera = rigid->cameras[f];
  noise = VectorXd::Constant(n, 0.05);
  m = 0;
  modes.resize(3 * n, 0);
  fix_gauge();
}

void HeadTrainer::update_shape() {
  const Index terms = m + 1;
  cv::parallel_for_(cv::Range(0, static_cast<int>(n)), [&](const cv::Range& range) {
    for (int at = range.start; at < range.end; ++at) {
      const Index i = at;
      const Index other = markup.mirror[static_cast<std::size_t>(at)];
      if (other < i) continue;
      MatrixXd normal = MatrixXd::Zero(3 * terms, 3 * terms);
      VectorXd right = VectorXd::Zero(3 * terms);
      for (const TrainingView& view : views) {
        VectorXd one(terms);
        one << 1, view.b;
        for (const Index point : {i, other}) {
          Eigen::Matrix<double, 2, 3> rows = view.camera.scale * view.camera.rotation.topRows<2>();
          if (point != i) rows.col(0) *= -1;
          const double w = view.weight[point];
          const Matrix3d square = w * rows.transpose() * rows;
          const Vector3d pull = w * rows.transpose() * (view.flat.col(point) - view.camera.shift);
          for (Index k = 0; k < terms; ++k) {
            right.segment<3>(3 * k) += one[k] * pull;
            for (Index l = 0; l <= k; ++l)
              normal.block<3, 3>(3 * k, 3 * l) += view.moment(k, l) * square;
          }
          if (other == i) break;
        }
      }
      for (Index k = 0; k < terms; ++k) {
        for (Index l = 0; l < k; ++l)
          normal.block<3, 3>(3 * l, 3 * k) = normal.block<3, 3>(3 * k, 3 * l).transpose();
        if (other != i) continue;
        // A point in the plane of symmetry stays in it.
        normal.row(3 * k).setZero();
        normal.col(3 * k).setZero();
        normal(3 * k, 3 * k) = 1;
        right[3 * k] = 0;
      }
      normal.diagonal().array() += 1e-9 * normal.trace() / static_cast<double>(3 * terms);
      const VectorXd solution = linalg::solve_symmetric(normal, right);
      for (Index k = 0; k < terms; ++k) {
        Vector3d value = solution.segment<3>(3 * k);
        for (const Index point : {i, other}) {
          if (k == 0) {
            mean.col(point) = value;
          } else {
            modes.block<3, 1>(3 * point, k - 1) = value;
          }
          value[0] = -value[0];
          if (other == i) break;
        }
      }
    }
  });
}

void HeadTrainer::fix_gauge() {
  if (m > 0) {
    MatrixXd moment = MatrixXd::Zero(m + 1, m + 1);
    for (const TrainingView& view : views) moment += view.moment;
    moment /= static_cast<double>(views.size());
    const VectorXd shift = moment.col(0).tail(m);
    const MatrixXd covariance = moment.bottomRightCorner(m, m) - shift * shift.transpose();
    Eigen::Map<VectorXd>(mean.data(), 3 * n) += modes * shift;
    const MatrixXd lower = linalg::Cholesky(covariance).lower();
    modes = modes * lower;
    for (TrainingView& view : views) {
      view.b = lower.triangularView<Eigen::Lower>().solve(VectorXd(view.b - shift));
    }
  }
  const Vector3d left = mean.col(markup.outer_eyes[0]);
  const Vector3d right = mean.col(markup.outer_eyes[1]);
  const Vector3d origin = (left + right) / 2;
  mean.colwise() -= origin;
  const double grow = options.outer_eye_mm / (right - left).norm();
  mean *= grow;
  modes *= grow;
  for (TrainingView& view : views) {
    ScaledOrthography& camera = view.camera;
    camera.shift += camera.scale * (camera.rotation * origin).head<2>();
    camera.scale /= grow;
  }
  if (m == 0) return;
  MatrixXd whole = MatrixXd::Zero(3 * n, 4);
  const Matrix3Xd centred = mean.colwise() - mean.rowwise().mean();
  for (Index i = 0; i < n; ++i) {
    whole(3 * i + 1, 0) = 1;
    whole(3 * i + 2, 1) = 1;
    whole.block<3, 1>(3 * i, 2) = centred.col(i);
    whole(3 * i + 1, 3) = -centred(2, i);
    whole(3 * i + 2, 3) = centred(1, i);
  }
  const MatrixXd basis = linalg::orthonormal_basis(whole);
  modes -= basis * (basis.transpose() * modes);
}

void HeadTrainer::update_noise() {
  for (Index i = 0; i < n; ++i) {
    double sum = 0;
    double weight = 0;
    for (const TrainingView& view : views) {
      for (const Index point :
           {i, static_cast<Index>(markup.mirror[static_cast<std::size_t>(i)])}) {
        sum += view.weight[point] * view.squared[point];
        weight += 2 * view.weight[point];
      }
    }
    // At least a tenth of a percent of the head, so that no point gets an infinite weight.
    noise[i] = std::sqrt(std::max(sum / std::max(weight, 1e-12), 1e-6));
  }
}

}  // namespace tarsier::face::head
