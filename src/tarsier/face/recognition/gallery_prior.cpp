// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/gallery_prior.h"

#include "tarsier/core/rng.h"
#include "tarsier/face/recognition/features.h"
#include "tarsier/face/recognition/same_camera.h"
#include "tarsier/face/recognition/subspace.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::recognition {
namespace {

// Components that a gallery adds to those of a background.
constexpr int kMaxOwnComponents = 200;
// Weight of the prior relative to strangers' scores in the gallery itself.
constexpr double kPriorPeople = 6;

}  // namespace

Rows extended_basis(const Rows& basis, const Rows& centred) {
  const Rows outside = centred - products(products(centred, basis), Rows(basis.transpose()));
  const Eigen::RowVectorXf zero = Eigen::RowVectorXf::Zero(centred.cols());
  const Pca more = principal_components(outside, kMaxOwnComponents, &zero);
  Rows out(basis.rows() + more.components.rows(), basis.cols());
  out << basis, more.components;
  return out;
}

Eigen::MatrixXd prior_within_scatter(const Background& background, Eigen::Index more) {
  const Eigen::Index known = background.within.rows();
  const auto left = static_cast<double>(std::max<Eigen::Index>(1, background.mean.size() - known));
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(known + more, known + more);
  out.topLeftCorner(known, known) = background.within;
  out.diagonal().tail(more).setConstant(background.within_residual_variance / left);
  return out;
}

CalibrationPrior impostor_prior(const Recognizer& model, const Background& background) {
  constexpr int kImpostors = 400;
  CalibrationPrior prior = background.prior;
  double sum = 0;
  double square = 0;
  double count = 0;
  Rng rng(20);
  const Eigen::VectorXf deviation = background.variance.cwiseMax(0).cwiseSqrt().cast<float>();
  const Eigen::RowVectorXf shift = background.mean - model.mean;
  const Rows in_template = products(background.basis, model.components);  // m x c
  const Rows shift_in_template = products(Rows(shift), model.components);
  const Rows shift_in_basis = products(Rows(shift), background.basis);
  for (int i = 0; i < kImpostors; ++i) {
    Rows x(1, deviation.size());
    for (Eigen::Index k = 0; k < deviation.size(); ++k)
      x(0, k) = deviation(k) * static_cast<float>(rng.normal());
    Rows probe = x * in_template + shift_in_template;
    Eigen::VectorXd length(1);
    length(0) = (x + shift_in_basis).cast<double>().squaredNorm() +
                std::max(0.0, shift.cast<double>().squaredNorm() -
                                  shift_in_basis.cast<double>().squaredNorm()) +
                background.residual_variance;
    scale_rows(probe, length, model.eigenvalues, model.residual_variance);
    const std::vector<float> values(probe.data(), probe.data() + probe.size());
    for (const PersonScore& person : identify_template(model, values)) {
      sum += person.score;
      square += person.score * person.score;
      count += 1;
    }
  }
  const double mean = sum / count;
  const SameCameraAdjustment& camera = same_camera_adjustment(model.options.algorithm);
  prior.location = mean + camera.shift;
  prior.scale =
      std::max(0.02, camera.spread * std::sqrt(std::max(0.0, square / count - mean * mean)));
  prior.weight = kPriorPeople;
  return prior;
}

Eigen::RowVectorXf mean_with_background(const Eigen::RowVectorXf& own, int people,
                                        const Background* background) {
  if (background == nullptr) return own;
  const double weight = people > 1 ? people : 0;
  const double share = weight / (weight + background->weight);
  return static_cast<float>(share) * own + static_cast<float>(1 - share) * background->mean;
}

}  // namespace tarsier::face::recognition
