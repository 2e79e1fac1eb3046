// SPDX-License-Identifier: MIT
// Analytic derivatives against numeric ones.
#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/fit_level.h"
#include "tarsier/face/appearance/testing_portraits.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::face::appearance {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Vector2d;

constexpr double kStep = 1e-3;  // px of the frame

class JacobianTest : public ::testing::Test {
 protected:
  JacobianTest() {
    AppearanceOptions options;
    options.levels = 1;
    options.colour = false;
    NoProgress silent;
    model_ = train_appearance_model(test_support::portraits(30, 1), {}, options, silent, {});
    const FitOptions fit;
    level_.emplace(make_level(model_, model_.levels[0], fit, model_.shape.mode_count()));
  }

  // Position of the frame's pixel after parameter k was moved by `step`.
  [[nodiscard]] Vector2d moved(Index pixel, Index k, double step) const {
    const Texture& texture = *level_->texture;
    const auto& at = texture.warp.pixels()[static_cast<std::size_t>(pixel)];
    const auto& triangle = model_.mesh[static_cast<std::size_t>(at.triangle)];
    Eigen::Matrix3d before;
    Eigen::Matrix<double, 2, 3> after;
    for (int v = 0; v < 3; ++v) {
      const int corner = triangle[static_cast<std::size_t>(v)];
      const Vector2d p = texture.origin + level_->mean.col(corner);
      before.col(v) << p, 1;
      after.col(v) = p + step * level_->basis.block<2, 1>(2 * corner, k);
    }
    return after * before.inverse() * Eigen::Vector3d(at.x, at.y, 1);
  }

  AppearanceModel model_;
  std::optional<FitLevel> level_;
};

TEST_F(JacobianTest, WarpJacobianMatchesNumericDerivative) {
  const auto pixels = static_cast<Index>(level_->texture->warp.pixels().size());
  ASSERT_GT(level_->parameters, 5);
  double worst = 0;
  for (Index k = 0; k < level_->parameters; ++k) {
    for (Index i = 0; i < pixels; i += 97) {
      const Vector2d numeric = (moved(i, k, kStep) - moved(i, k, -kStep)) / (2 * kStep);
      worst = std::max(worst, std::abs(numeric.x() - double{level_->jacobian_x(i, k)}));
      worst = std::max(worst, std::abs(numeric.y() - double{level_->jacobian_y(i, k)}));
    }
  }
  EXPECT_LT(worst, 1e-4);
}

TEST_F(JacobianTest, SteepestDescentImagesMatchNumericDerivative) {
  const auto f = [](const Vector2d& p) {
    return 50 * std::sin(0.06 * p.x() + 0.4) * std::cos(0.05 * p.y());
  };
  const auto& pixels = level_->texture->warp.pixels();
  const auto count = static_cast<Index>(pixels.size());
  Eigen::VectorXf target(count);
  for (Index i = 0; i < count; ++i) {
    const auto& at = pixels[static_cast<std::size_t>(i)];
    target[i] = static_cast<float>(f(Vector2d(at.x, at.y)));
  }
  Eigen::MatrixXf images;
  steepest_descent(*level_, target.data(), images);
  for (Index k = 0; k < level_->parameters; ++k) {
    double difference = 0;
    double total = 0;
    for (Index i = 0; i < count; ++i) {
      const double numeric = (f(moved(i, k, kStep)) - f(moved(i, k, -kStep))) / (2 * kStep);
      difference += std::pow(numeric - double{images(i, k)}, 2);
      total += numeric * numeric;
    }
    // The remaining differences come from one-sided differences at the mesh's edge.
    EXPECT_LT(difference, 1e-3 * total) << "parameter " << k;
  }
}

TEST_F(JacobianTest, ProjectedImagesAreOrthogonalToTextureModes) {
  const Eigen::MatrixXf overlap = level_->modes.transpose() * level_->descent;
  EXPECT_LT(overlap.cwiseAbs().maxCoeff(), 1e-3F * level_->descent.colwise().norm().maxCoeff());
}

TEST_F(JacobianTest, BasisIsOrthonormal) {
  const Eigen::MatrixXd gram = level_->basis.transpose() * level_->basis;
  EXPECT_LT((gram - Eigen::MatrixXd::Identity(gram.rows(), gram.cols())).cwiseAbs().maxCoeff(),
            1e-9);
}

}  // namespace
}  // namespace tarsier::face::appearance
