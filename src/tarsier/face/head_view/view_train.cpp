// SPDX-License-Identifier: MIT
#include "tarsier/face/head_view/view_train.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/media/archive.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace tarsier::face::head_view {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMaxViews = 20'000;

// The samples, followed by their mirrored copies in the same order.
std::vector<ViewSample> with_mirrored(const std::vector<ViewSample>& samples) {
  std::vector<ViewSample> all = samples;
  all.reserve(2 * samples.size());
  for (const ViewSample& sample : samples) {
    all.push_back({mirrored(sample.view),
                   {sample.truth.pitch_deg, -sample.truth.yaw_deg},
                   sample.group,
                   sample.nominal});
  }
  return all;
}

Eigen::MatrixXf rounded(const Eigen::MatrixXf& matrix) {
  return matrix.unaryExpr([](float value) { return rounded_to_half(value); });
}

// The unit vectors of greatest variance of the columns, whose mean is 0; `max_count` of them, or
// fewer if the others have none.
MatrixXd principal_directions(const MatrixXd& columns, Index max_count) {
  const bool few = columns.cols() < columns.rows();
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(
      few ? MatrixXd(columns.transpose() * columns) : MatrixXd(columns * columns.transpose()));
  const Index n = eigen.values.size();
  Index count = 0;
  while (count < std::min(max_count, n) && eigen.values[n - 1 - count] > 1e-9 * eigen.values[n - 1])
    ++count;
  const MatrixXd vectors = eigen.vectors.rightCols(count).rowwise().reverse();
  return few ? MatrixXd((columns * vectors).colwise().normalized()) : vectors;
}

void set_basis(const std::vector<ViewSample>& samples, const TrainViewOptions& options,
               ViewModel& model) {
  const auto n = static_cast<Index>(samples.size());
  const Index offsets = samples.front().view.offsets.size();
  MatrixXd appearance(kGradients + offsets, n);
  for (Index i = 0; i < n; ++i) {
    const HeadView& view = samples[static_cast<std::size_t>(i)].view;
    TARSIER_REQUIRE(view.offsets.size() == offsets, "views of {} and {} offsets", offsets,
                    view.offsets.size());
    appearance.col(i) << view.gradients.cast<double>(), view.offsets.cast<double>();
  }
  const VectorXd mean = appearance.rowwise().mean();
  appearance.colwise() -= mean;
  const double gradients = appearance.topRows(kGradients).squaredNorm();
  TARSIER_REQUIRE(gradients / static_cast<double>(n) > 1e-9, "the views are all alike");
  // Offsets are multiplied by `scale` in the PCA.
  const double of_offsets = appearance.bottomRows(offsets).squaredNorm();
  const double scale =
      of_offsets > 0 ? options.offset_weight * std::sqrt(gradients / of_offsets) : 0;
  appearance.bottomRows(offsets) *= scale;
  // Scale so that the mean squared distance of two views' gradients is 1 (except for the part
  // outside the components).
  MatrixXd basis = principal_directions(appearance, options.components) /
                   std::sqrt(2 * gradients / static_cast<double>(n));
  basis.bottomRows(offsets) *= scale;
  model.mean = mean.cast<float>();
  model.basis = rounded(basis.cast<float>());
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

// K + N.
MatrixXd kernel_of(const ViewModel& model, const std::vector<ViewSample>& samples,
                   const TrainViewOptions& options) {
  const Index n = model.centres.cols();
  MatrixXd kernel(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j <= i; ++j)
      kernel(i, j) = kernel(j, i) =
          std::exp(-model.gamma * static_cast<double>(
                                      (model.centres.col(i) - model.centres.col(j)).squaredNorm()));
  for (Index i = 0; i < n; ++i)
    kernel(i, i) +=
        samples[static_cast<std::size_t>(i)].nominal ? options.ridge : options.exact_ridge;
  return kernel;
}

// Adds variance * S; samples from `mirrored_from` on have the opposite sign.
void add_group_errors(const std::vector<ViewSample>& samples, std::size_t mirrored_from,
                      bool sign_changes, double variance, MatrixXd& kernel) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (!samples[i].nominal) continue;
    for (std::size_t j = 0; j < samples.size(); ++j) {
      if (!samples[j].nominal || samples[i].group != samples[j].group) continue;
      const bool differ = (i < mirrored_from) != (j < mirrored_from);
      kernel(static_cast<Index>(i), static_cast<Index>(j)) +=
          sign_changes && differ ? -variance : variance;
    }
  }
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
  set_basis(all, options, model);
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
  model.centres = rounded(model.centres);
  model.weights.resize(2, n);
  for (const int axis : {0, 1}) {  // pitch, yaw
    MatrixXd kernel = kernel_of(model, all, options);
    add_group_errors(all, samples.size(), axis == 1, options.group_error, kernel);
    model.weights.row(axis) =
        linalg::Cholesky(kernel).solve(corrections.col(axis)).transpose().cast<float>();
  }
  model.check();
  return model;
}

std::vector<CorrectedDirection> leave_groups_out(const std::vector<ViewSample>& samples,
                                                 const TrainViewOptions& options) {
  std::vector<CorrectedDirection> result(samples.size());
  std::set<int> groups;
  for (const ViewSample& sample : samples) groups.insert(sample.group);
  TARSIER_REQUIRE(groups.size() >= 2, "one group only: nothing is left to learn from");
  for (const int group : groups) {
    std::vector<ViewSample> others;
    for (const ViewSample& sample : samples)
      if (sample.group != group) others.push_back(sample);
    const ViewModel model = train_view_model(others, options);
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (samples[i].group == group) result[i] = correct_direction(model, samples[i].view);
  }
  return result;
}

}  // namespace tarsier::face::head_view
