// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/center_uncertainty.h"

#include "tarsier/core/at.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/bundle/bundle_problem.h"
#include "tarsier/sfm/bundle/bundle_solver.h"
#include "tarsier/sfm/bundle/point_selection.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr int kSamples = 12;
constexpr int kEvaluatedPointsPerImage = 600;
constexpr int kMaxPointObservations = 40;  // per point
constexpr double kMinSigma = 1e-6;         // px, used where all residuals are 0
constexpr double kReferenceSigma = 0.01;

BundleOptions lens_options(const MapperOptions& options, std::size_t images) {
  BundleOptions bundle;
  bundle.focal = options.refine_focal;
  bundle.center = options.refine_center && images >= 5;
  bundle.distortion = options.refine_distortion;
  return bundle;
}

// The share of coordinates beyond the number of unknowns: six per image and three per point, minus
// position, orientation and scale of the whole.
double redundancy_of(std::size_t observations, std::size_t images, std::size_t points) {
  const auto coordinates = 2 * static_cast<double>(observations);
  const double unknowns = 6 * static_cast<double>(images) + 3 * static_cast<double>(points) - 7;
  return (coordinates - unknowns) / coordinates;
}

}  // namespace

std::optional<CenterUncertainty> center_uncertainty(const Model& model,
                                                    const MapperOptions& options) {
  std::vector<int> images;
  for (std::size_t i = 0; i < model.images.size(); ++i)
    if (model.images[i].registered) images.push_back(static_cast<int>(i));
  if (images.size() < 3) return std::nullopt;
  std::vector<int> points;
  std::size_t observations = 0;
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    if (model.points[p].track.empty()) continue;
    points.push_back(static_cast<int>(p));
    observations += model.points[p].track.size();
  }
  BundleOptions bundle = lens_options(options, images.size());
  bundle.max_observations = kMaxPointObservations;
  bundle.points =
      select_points(model, points, images, kEvaluatedPointsPerImage, kMaxPointObservations);
  const ModelProblem of_model = problem_of(model, bundle);
  if (of_model.points.empty() || of_model.images.size() < 3) return std::nullopt;

  CenterUncertainty result;
  const double redundancy = redundancy_of(observations, images.size(), points.size());
  const std::vector<Eigen::Vector2d> residuals = residuals_of(of_model.problem);
  if (residuals.empty() || !(redundancy > 0)) return std::nullopt;
  const auto used = static_cast<double>(residuals.size());
  double squares_px = 0;
  for (const Eigen::Vector2d& residual : residuals) squares_px += residual.squaredNorm();
  result.sigma_px = std::max(kMinSigma, std::sqrt(squares_px / (2 * used * redundancy)));
  const double sigma = result.sigma_px * std::sqrt(used / static_cast<double>(observations));
  const auto samples = centers_under_noise(of_model.problem, sigma, kSamples, options.seed);
  if (samples.empty()) return std::nullopt;

  std::vector<Eigen::Vector3d> centers;
  centers.reserve(of_model.images.size());
  for (const int image : of_model.images) centers.push_back(model.images[at(image)].pose.center());
  const auto columns = geometry::columns_of(centers);
  const double extent = (columns.rowwise().maxCoeff() - columns.rowwise().minCoeff()).norm();
  std::vector<double> squares(centers.size(), 0);
  for (const std::vector<Eigen::Vector3d>& moved : samples) {
    const auto similarity = geometry::similarity_between(geometry::columns_of(moved), columns);
    if (!similarity) return std::nullopt;
    for (std::size_t k = 0; k < centers.size(); ++k)
      squares[k] += (*similarity * moved[k] - centers[k]).squaredNorm() / kSamples;
  }
  result.sigmas.assign(model.images.size(), 0);
  for (std::size_t k = 0; k < centers.size(); ++k)
    result.sigmas[at(of_model.images[k])] = std::sqrt(squares[k]) / extent;
  result.worst = *std::max_element(result.sigmas.begin(), result.sigmas.end());
  result.mean = std::sqrt(std::accumulate(squares.begin(), squares.end(), 0.0) /
                          static_cast<double>(squares.size())) /
                extent;
  if (!std::isfinite(result.mean)) return std::nullopt;
  return result;
}

double uncertainty_trust_factor(const CenterUncertainty& uncertainty) {
  const double ratio = uncertainty.worst / kReferenceSigma;
  return 0.5 + 0.5 / (1 + ratio * ratio);
}

void add_uncertainty(const MapperOptions& options, Reconstruction& made) {
  made.uncertainties.clear();
  for (std::size_t m = 0; m < made.models.size(); ++m) {
    made.uncertainties.push_back(center_uncertainty(made.models[m], options));
    if (made.uncertainties[m] && m < made.trust.size())
      made.trust[m] *= uncertainty_trust_factor(*made.uncertainties[m]);
  }
}

}  // namespace tarsier::sfm
