// SPDX-License-Identifier: MIT
#include "tarsier/face/head_view/view_train.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace tarsier::face::head_view {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMaxViews = 20'000;

std::vector<ViewSample> with_mirrored(const std::vector<ViewSample>& samples) {
  std::vector<ViewSample> all = samples;
  all.reserve(2 * samples.size());
  for (const ViewSample& sample : samples) {
    all.push_back(
        {mirrored(sample.view), {sample.truth.pitch_deg, -sample.truth.yaw_deg}, sample.group});
  }
  return all;
}

void set_basis(const std::vector<ViewSample>& samples, int components, ViewModel& model) {
  const auto n = static_cast<Index>(samples.size());
  MatrixXd gradients(kGradients, n);
  for (Index i = 0; i < n; ++i)
    gradients.col(i) = samples[static_cast<std::size_t>(i)].view.gradients.cast<double>();
  const VectorXd mean = gradients.rowwise().mean();
  gradients.colwise() -= mean;
  const MatrixXd covariance = gradients * gradients.transpose() / static_cast<double>(n);
  const double total = covariance.trace();
  TARSIER_REQUIRE(total > 1e-9, "the views are all alike");
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(covariance);
  // The mean squared distance of two views becomes 1 (less what is beyond the components).
  model.mean = mean.cast<float>();
  model.basis = (eigen.vectors.rightCols(components).rowwise().reverse() / std::sqrt(2 * total))
                    .cast<float>();
}

void set_angle_scale(const std::vector<ViewSample>& samples, double weight, ViewModel& model) {
  const auto n = static_cast<Index>(samples.size());
  MatrixXd angles(3, n);
  for (Index i = 0; i < n; ++i) {
    const head::HeadAngles& a = samples[static_cast<std::size_t>(i)].view.angles;
    angles.col(i) << a.pitch_deg, a.yaw_deg, a.roll_deg;
  }
  angles.colwise() -= angles.rowwise().mean().eval();
  const double variance = angles.squaredNorm() / static_cast<double>(n);
  TARSIER_REQUIRE(variance > 1e-6, "the heads all look the same way");
  model.angle_scale.setConstant(static_cast<float>(std::sqrt(2 * variance) / weight));
}

}  // namespace

ViewModel train_view_model(const std::vector<ViewSample>& samples,
                           const TrainViewOptions& options) {
  options.check();
  TARSIER_REQUIRE(samples.size() >= 8, "{} views, at least 8 are needed", samples.size());
  TARSIER_REQUIRE(samples.size() * (options.mirror ? 2 : 1) <= kMaxViews, "{} views, at most {}",
                  samples.size(), kMaxViews / (options.mirror ? 2 : 1));
  const std::vector<ViewSample> all = options.mirror ? with_mirrored(samples) : samples;
  const auto n = static_cast<Index>(all.size());
  ViewModel model;
  model.gamma = options.gamma;
  model.trained_on = static_cast<int>(samples.size());
  set_basis(all, static_cast<int>(std::min<Index>(options.components, n - 1)), model);
  set_angle_scale(all, options.angle_weight, model);
  model.centres.resize(model.basis.cols() + 3, n);
  MatrixXd corrections(n, 2);
  for (Index i = 0; i < n; ++i) {
    const ViewSample& sample = all[static_cast<std::size_t>(i)];
    model.centres.col(i) = model.point_of(sample.view);
    corrections.row(i) << sample.truth.pitch_deg - sample.view.angles.pitch_deg,
        sample.truth.yaw_deg - sample.view.angles.yaw_deg;
  }
  TARSIER_REQUIRE(corrections.allFinite() && model.centres.allFinite(),
                  "numbers that are not finite");
  MatrixXd kernel(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j <= i; ++j)
      kernel(i, j) = kernel(j, i) = std::exp(
          -options.gamma *
          static_cast<double>((model.centres.col(i) - model.centres.col(j)).squaredNorm()));
  kernel.diagonal().array() += options.ridge;
  model.weights = linalg::Cholesky(kernel).solve(corrections).transpose().cast<float>();
  model.check();
  return model;
}

std::vector<Direction> leave_groups_out(const std::vector<ViewSample>& samples,
                                        const TrainViewOptions& options) {
  std::vector<Direction> result(samples.size());
  std::set<int> groups;
  for (const ViewSample& sample : samples) groups.insert(sample.group);
  TARSIER_REQUIRE(groups.size() >= 2, "one group only: nothing is left to learn from");
  for (const int group : groups) {
    std::vector<ViewSample> others;
    for (const ViewSample& sample : samples)
      if (sample.group != group) others.push_back(sample);
    const ViewModel model = train_view_model(others, options);
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (samples[i].group == group) result[i] = looks_to(model, samples[i].view);
  }
  return result;
}

}  // namespace tarsier::face::head_view
