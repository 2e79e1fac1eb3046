// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/pair_scores.h"

#include "tarsier/core/progress.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/same_camera.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace tarsier::face::recognition {
namespace {

// Random coordinates of faces, distributed as the background's people.
Rows random_faces(const Background& background, int count, Rng& rng) {
  const Eigen::Index m = background.basis.rows();
  const Eigen::VectorXd deviation = background.variance.cwiseMax(0).cwiseSqrt();
  Rows out(count, m + 1);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index k = 0; k < m; ++k)
      out(i, k) = static_cast<float>(deviation(k) * rng.normal());
    out(i, m) = static_cast<float>(background.residual_variance);
  }
  return out;
}

}  // namespace

PairScores pair_scores(const Background& background) {
  constexpr int kPairs = 2000;
  TARSIER_REQUIRE(background.basis.rows() > 0, "a background of a mean alone");
  PairScores out;
  RecognizerOptions options;
  options.algorithm = background.network ? Algorithm::kDeep : Algorithm::kDefault;
  // One face at the mean adds no information: the model is that of the background.
  Rows mean = Rows::Zero(1, background.basis.rows() + 1);
  mean(0, background.basis.rows()) = static_cast<float>(background.residual_variance);
  NoProgress quiet;
  const std::vector<std::string> labels{"nobody"};
  out.model = train_coordinates(mean, labels, options, quiet, {}, background);
  out.model.labels.clear();
  out.model.people.clear();
  out.model.templates.resize(0, out.model.template_length());
  out.model.refresh();
  Rng rng(20);
  const Rows a =
      templates_of_coordinates(out.model, background, random_faces(background, kPairs, rng));
  const Rows b =
      templates_of_coordinates(out.model, background, random_faces(background, kPairs, rng));
  double sum = 0;
  double square = 0;
  for (Eigen::Index i = 0; i < kPairs; ++i) {
    const double score = a.row(i).cast<double>().dot(b.row(i).cast<double>());
    sum += score;
    square += score * score;
  }
  const double average = sum / kPairs;
  const SameCameraAdjustment& camera = same_camera_adjustment(options.algorithm);
  Calibration calibration;
  calibration.location = average + camera.shift;
  calibration.scale =
      std::max(0.02, camera.spread * std::sqrt(std::max(0.0, square / kPairs - average * average)));
  calibration.genuine_mean = background.prior.genuine;
  out.model.calibration = calibration;
  out.same_camera = camera.shift;
  out.background_weight = background.weight;
  return out;
}

}  // namespace tarsier::face::recognition
