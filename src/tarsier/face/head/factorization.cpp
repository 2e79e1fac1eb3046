// SPDX-License-Identifier: MIT
#include "tarsier/face/head/factorization.h"

#include "tarsier/linalg/decompositions.h"

#include <Eigen/Geometry>

#include <cmath>

namespace tarsier::face::head {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The `count` principal directions of the rows, n x count.
MatrixXd principal_directions(const MatrixXd& rows, Index count) {
  const linalg::SymmetricEigen solver = linalg::symmetric_eigen(rows.transpose() * rows);
  return solver.vectors.rightCols(count).rowwise().reverse();
}

// The rotation whose first two rows are nearest to two rows of similar length.
Eigen::Matrix3d rotation_of_rows(const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
  const Eigen::Vector3d sum = (first.normalized() + second.normalized()).normalized();
  const Eigen::Vector3d difference = (first.normalized() - second.normalized()).normalized();
  Eigen::Matrix3d rotation;
  rotation.row(0) = (sum + difference).normalized();
  rotation.row(1) = (sum - difference).normalized();
  rotation.row(2) = rotation.row(0).cross(rotation.row(1));
  return rotation;
}

}  // namespace

std::optional<Factorization> factorize_symmetric(const std::vector<Eigen::Matrix2Xd>& faces,
                                                 const std::vector<int>& mirror) {
  const auto count = static_cast<Index>(faces.size());
  const auto n = static_cast<Index>(mirror.size());
  MatrixXd all(2 * count, n);
  std::vector<Eigen::Vector2d> middles(faces.size());
  for (Index f = 0; f < count; ++f) {
    const auto& face = faces[static_cast<std::size_t>(f)];
    middles[static_cast<std::size_t>(f)] = face.rowwise().mean();
    all.middleRows(2 * f, 2) = face.colwise() - middles[static_cast<std::size_t>(f)];
  }
  MatrixXd swapped(all.rows(), n);
  for (Index i = 0; i < n; ++i) swapped.col(i) = all.col(mirror[static_cast<std::size_t>(i)]);
  const MatrixXd odd = (all - swapped) / 2;   // = camera's x column * x
  const MatrixXd even = (all + swapped) / 2;  // = camera's y and z columns * [y; z]

  const MatrixXd x_basis = principal_directions(odd, 1);
  const MatrixXd yz_basis = principal_directions(even, 2);
  MatrixXd rows(2 * count, 3);
  rows.col(0) = odd * x_basis;
  rows.rightCols(2) = even * yz_basis;

  // Rows a, b of a camera: a G a' = b G b' and a G b' = 0 with G = diag(g0, [g1 g2; g2 g3]).
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  const auto products = [](const Eigen::RowVector3d& a, const Eigen::RowVector3d& b) {
    return Eigen::Vector4d(a[0] * b[0], a[1] * b[1], a[1] * b[2] + a[2] * b[1], a[2] * b[2]);
  };
  for (Index f = 0; f < count; ++f) {
    const Eigen::RowVector3d a = rows.row(2 * f);
    const Eigen::RowVector3d b = rows.row(2 * f + 1);
    const Eigen::Vector4d length = products(a, a) - products(b, b);
    const Eigen::Vector4d angle = products(a, b);
    normal += length * length.transpose() + 4 * angle * angle.transpose();
  }
  const linalg::SymmetricEigen solver = linalg::symmetric_eigen(normal);
  // Two solutions: the views do not separate depth from width.
  if (!(solver.values[1] > 1e-9 * solver.values[3])) return std::nullopt;
  Eigen::Vector4d g = solver.vectors.col(0);
  if (g[0] < 0) g = -g;
  Eigen::Matrix2d yz;
  yz << g[1], g[2], g[2], g[3];
  const Eigen::LLT<Eigen::Matrix2d> factor(yz);
  if (g[0] <= 0 || factor.info() != Eigen::Success) return std::nullopt;
  const Eigen::Matrix2d lower = factor.matrixL();
  if (lower(1, 1) < 1e-6 * lower(0, 0)) return std::nullopt;

  Factorization result;
  result.shape.resize(3, n);
  result.shape.row(0) = x_basis.transpose() / std::sqrt(g[0]);
  result.shape.bottomRows(2) = lower.inverse() * yz_basis.transpose();
  rows.col(0) *= std::sqrt(g[0]);
  rows.rightCols(2) *= lower;

  // Remaining ambiguity: the sign of x, a rotation of y and z, the sign of z. The mean camera is
  // assumed to look straight at the face.
  Eigen::Vector2d down = Eigen::Vector2d::Zero();
  double right = 0;
  for (Index f = 0; f < count; ++f) {
    down += rows.row(2 * f + 1).tail(2).transpose().normalized();
    right += rows(2 * f, 0);
  }
  if (right < 0) {
    result.shape.row(0) *= -1;
    rows.col(0) *= -1;
  }
  down.normalize();
  Eigen::Matrix2d turn;  // new y, z from old
  turn << down[0], down[1], -down[1], down[0];
  result.shape.bottomRows(2) = turn * result.shape.bottomRows(2);
  rows.rightCols(2) = rows.rightCols(2) * turn.transpose();
  const VectorXd radius = result.shape.topRows(2).colwise().squaredNorm().transpose();
  const VectorXd centred = radius.array() - radius.mean();
  if (result.shape.row(2).dot(centred) < 0) {
    result.shape.row(2) *= -1;
    rows.col(2) *= -1;
  }
  for (Index f = 0; f < count; ++f) {
    ScaledOrthography camera;
    const Eigen::Vector3d a = rows.row(2 * f);
    const Eigen::Vector3d b = rows.row(2 * f + 1);
    camera.scale = (a.norm() + b.norm()) / 2;
    if (!(camera.scale > 0)) return std::nullopt;
    camera.rotation = rotation_of_rows(a, b);
    camera.shift = middles[static_cast<std::size_t>(f)];
    result.cameras.push_back(camera);
  }
  if (!result.shape.allFinite()) return std::nullopt;
  return result;
}

}  // namespace tarsier::face::head
