// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/appearance/fit_level.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::appearance {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::MatrixXf;
using Eigen::VectorXd;
using Eigen::VectorXf;

// Extends a basis to the points of the frame: outer points move with the points they belong to.
MatrixXd with_outer(const AppearanceModel& model, const MatrixXd& basis) {
  const Index n = model.points();
  MatrixXd all(2 * (n + static_cast<Index>(model.outer.size())), basis.cols());
  for (Index k = 0; k < basis.cols(); ++k) {
    const VectorXd column = basis.col(k);
    const Eigen::Matrix2Xd points = Eigen::Map<const Eigen::Matrix2Xd>(column.data(), 2, n);
    const Eigen::Matrix2Xd extended = model.extended(points);
    all.col(k) = Eigen::Map<const VectorXd>(extended.data(), extended.size());
  }
  return all;
}

std::vector<FitLevel::Neighbours> neighbours_of(const shape::PiecewiseWarp& warp) {
  cv::Mat index(warp.size(), CV_32S, cv::Scalar(-1));
  int at = 0;
  for (const auto& pixel : warp.pixels()) index.at<int>(pixel.y, pixel.x) = at++;
  const auto find = [&](int x, int y) {
    return x < 0 || y < 0 || x >= index.cols || y >= index.rows ? -1 : index.at<int>(y, x);
  };
  std::vector<FitLevel::Neighbours> result;
  result.reserve(warp.pixels().size());
  at = 0;
  for (const auto& pixel : warp.pixels()) {
    const auto pair = [&](int before, int behind, int& a, int& b, float& per) {
      const int both = (before >= 0 ? 1 : 0) + (behind >= 0 ? 1 : 0);
      a = before >= 0 ? before : at;
      b = behind >= 0 ? behind : at;
      per = both == 0 ? 0 : 1.0F / static_cast<float>(both);
    };
    FitLevel::Neighbours n{};
    pair(find(pixel.x - 1, pixel.y), find(pixel.x + 1, pixel.y), n.left, n.right, n.per_x);
    pair(find(pixel.x, pixel.y - 1), find(pixel.x, pixel.y + 1), n.above, n.below, n.per_y);
    result.push_back(n);
    ++at;
  }
  return result;
}

}  // namespace

void steepest_descent(const FitLevel& level, const float* target, MatrixXf& out) {
  const int channels = level.channels;
  const auto pixels = static_cast<Index>(level.neighbours.size());
  const Index count = level.parameters;
  out.resize(pixels * channels, count);
  // Blocks of pixels whose derivatives fit into the cache.
  constexpr Index kBlock = 256;
  constexpr int kMaxChannels = 8;
  float gx[kBlock * kMaxChannels];
  float gy[kBlock * kMaxChannels];
  for (Index first = 0; first < pixels; first += kBlock) {
    const Index size = std::min(kBlock, pixels - first);
    for (Index i = 0; i < size; ++i) {
      const FitLevel::Neighbours& n = level.neighbours[static_cast<std::size_t>(first + i)];
      const float* l = target + std::ptrdiff_t{n.left} * channels;
      const float* r = target + std::ptrdiff_t{n.right} * channels;
      const float* a = target + std::ptrdiff_t{n.above} * channels;
      const float* b = target + std::ptrdiff_t{n.below} * channels;
      for (int c = 0; c < channels; ++c) {
        gx[i * channels + c] = (r[c] - l[c]) * n.per_x;
        gy[i * channels + c] = (b[c] - a[c]) * n.per_y;
      }
    }
    for (Index k = 0; k < count; ++k) {
      const float* jx = level.jacobian_x.data() + k * pixels + first;
      const float* jy = level.jacobian_y.data() + k * pixels + first;
      float* to = out.data() + (k * pixels + first) * channels;
      if (channels == 1) {
        for (Index i = 0; i < size; ++i) to[i] = gx[i] * jx[i] + gy[i] * jy[i];
      } else {
        for (Index i = 0; i < size; ++i)
          for (int c = 0; c < channels; ++c)
            to[i * channels + c] = gx[i * channels + c] * jx[i] + gy[i * channels + c] * jy[i];
      }
    }
  }
}

FitLevel make_level(const AppearanceModel& model, const Texture& texture, const FitOptions& options,
                    int modes) {
  FitLevel level(model, texture);
  level.crop = crop_frame(texture);
  level.channels = channel_count(texture.channels);
  TARSIER_REQUIRE(level.channels <= 8, "{} channels", level.channels);
  level.parameters = 4 + modes;
  const double scale = texture.px_per_unit;
  level.mean = scale * model.shape.mean;
  level.mean_square = level.mean.squaredNorm();
  level.basis = shape::combined_basis(model.shape).leftCols(level.parameters);
  level.all_basis = with_outer(model, level.basis);

  const auto& pixels = texture.warp.pixels();
  const auto count = static_cast<Index>(pixels.size());
  level.jacobian_x.setZero(count, level.parameters);
  level.jacobian_y.setZero(count, level.parameters);
  for (Index i = 0; i < count; ++i) {
    const auto& pixel = pixels[static_cast<std::size_t>(i)];
    const auto& triangle = model.mesh[static_cast<std::size_t>(pixel.triangle)];
    for (std::size_t v = 0; v < 3; ++v) {
      level.jacobian_x.row(i) +=
          pixel.weight[v] * level.all_basis.row(2 * triangle[v]).cast<float>();
      level.jacobian_y.row(i) +=
          pixel.weight[v] * level.all_basis.row(2 * triangle[v] + 1).cast<float>();
    }
  }
  level.neighbours = neighbours_of(texture.warp);

  const Index n = texture.size();
  const Index m = texture.mode_count();
  level.modes.resize(n, 1 + m);
  level.modes.col(0) = texture.mean.normalized();
  level.modes.rightCols(m) = texture.modes();
  const double noise2 = std::max(texture.noise * texture.noise, 1e-6);
  level.mode_weights.setOnes(1 + m);
  for (Index k = 0; k < m; ++k) {
    const double variance = texture.deviation[k] * texture.deviation[k];
    level.mode_weights[1 + k] =
        static_cast<float>(variance / (variance + options.texture_prior * noise2 + 1e-30));
  }
  level.unit = std::sqrt(1 + texture.deviation.squaredNorm() / static_cast<double>(n) + noise2);
  level.shape_prior.setZero(level.parameters);
  for (int k = 0; k < modes; ++k) {
    const double deviation = std::max(scale * model.shape.deviation[k], 1e-6 * scale);
    level.shape_prior[4 + k] = options.shape_prior * noise2 / (deviation * deviation);
  }

  steepest_descent(level, texture.mean.data(), level.descent);
  // Normalised textures contain no constants.
  if (has_offset(texture.channels)) level.descent.rowwise() -= level.descent.colwise().mean();
  const MatrixXf overlap = level.modes.transpose() * level.descent;
  level.descent.noalias() -= level.modes * (level.mode_weights.asDiagonal() * overlap);
  // J^T (1 - A w A^T) J, symmetrised: half from the plain images, half from the projected ones.
  MatrixXf plain;
  steepest_descent(level, texture.mean.data(), plain);
  if (has_offset(texture.channels)) plain.rowwise() -= plain.colwise().mean();
  MatrixXd hessian = (plain.transpose() * level.descent).cast<double>();
  hessian = (0.5 * (hessian + hessian.transpose())).eval();
  // A direction that has no effect on the texture is not changed.
  hessian.diagonal().array() += 1e-6 * hessian.diagonal().maxCoeff() + 1e-12;
  hessian.diagonal() += level.shape_prior;
  level.inverse_hessian =
      linalg::Cholesky(hessian).solve(MatrixXd::Identity(level.parameters, level.parameters));
  TARSIER_REQUIRE(level.inverse_hessian.allFinite(), "a model whose texture shows no direction");
  return level;
}

}  // namespace tarsier::face::appearance
