// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/quality.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/least_squares.h"
#include "tarsier/face/shape/shape_model.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::regression {

namespace {

constexpr double kGoodError = 0.02;  // error, share of the shape's size
constexpr double kBadError = 0.20;

float target_quality(double error) {
  return static_cast<float>(std::clamp((kBadError - error) / (kBadError - kGoodError), 0.0, 1.0));
}

// Not at a finer resolution than the frame needs. Shapes far from a face are evaluated where they
// are.
void features_at(const Quality& model, const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                 DescentWorkspace& workspace, float* out) {
  const Reduced reduced = reduce_around(gray, points, model.stage.scale.px_per_unit);
  const Eigen::Matrix2Xd there = (points.colwise() - reduced.offset) / reduced.scale;
  stage_features(model.stage, model.mean, reduced.gray, there, workspace, out);
}

}  // namespace

Quality train_quality(const std::vector<TrainingFace>& faces, const std::vector<RatedFit>& fits,
                      const QualityOptions& options, Progress& progress,
                      const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(!faces.empty() && !fits.empty(), "{} faces, {} fits", faces.size(), fits.size());
  Quality model;
  {
    std::vector<Eigen::Matrix2Xd> shapes;
    shapes.reserve(faces.size());
    for (const TrainingFace& face : faces) shapes.push_back(face.points);
    if (shapes.size() < 2) shapes.push_back(shapes.front());
    model.mean = shape::train_shape_model(shapes).mean;
  }
  std::vector<const cv::Mat*> images;
  std::vector<Eigen::Matrix2Xd> points;
  for (const TrainingFace& face : faces) {
    images.push_back(&face.gray);
    points.push_back(face.points);
  }
  compress_descriptors(model.stage, options.scale, options.components, model.mean, images, points);

  const int n = static_cast<int>(model.mean.cols());
  const int seen = static_cast<int>(fits.size());
  // An additional training row for a uniform image (covered lens, wall), which no face's
  // surroundings represent. It has half the weight of all others.
  const int count = seen + 1;
  const float weight = std::sqrt(0.5F * static_cast<float>(seen));
  Rows features;
  features.columns = n * options.components + 1;
  features.values.resize(static_cast<std::size_t>(count) *
                         static_cast<std::size_t>(features.columns));
  Rows targets;
  targets.columns = 1;
  targets.values.resize(static_cast<std::size_t>(count));
  const cv::Mat nothing(64, 64, CV_8UC1, cv::Scalar(100));
  const Eigen::Matrix2Xd somewhere = (model.mean * 16).colwise() + Eigen::Vector2d(32, 32);
  progress.begin("quality", count, "fits");
  cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
    DescentWorkspace workspace;
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      features.row(i)[features.columns - 1] = 1;
      progress.advance();
      if (i >= seen) {
        features_at(model, nothing, somewhere, workspace, features.row(i));
        for (int c = 0; c < features.columns; ++c) features.row(i)[c] *= weight;
        targets.row(i)[0] = 0;
        continue;
      }
      const RatedFit& fit = fits[static_cast<std::size_t>(i)];
      const TrainingFace& face = faces[static_cast<std::size_t>(fit.face)];
      features_at(model, face.gray, fit.points, workspace, features.row(i));
      const double error =
          (fit.points - face.points).colwise().norm().mean() / shape_size(face.points);
      targets.row(i)[0] = target_quality(error);
    }
  });
  throw_if_stopped(stop);
  Eigen::MatrixXf squares = cross_products(features, features, 0, count);
  const Eigen::MatrixXf products = cross_products(features, targets, 0, count);
  const float lambda = static_cast<float>(options.ridge) *
                       squares.diagonal().head(features.columns - 1).sum() /
                       static_cast<float>(features.columns - 1);
  const Eigen::MatrixXf solution = ridge(std::move(squares), products, lambda);
  model.stage.weights = solution.topRows(features.columns - 1).transpose();
  model.stage.bias = solution.bottomRows(1).transpose();
  progress.end();
  return model;
}

double quality_of(const Quality& model, const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                  DescentWorkspace& workspace) {
  TARSIER_REQUIRE(points.cols() == model.mean.cols(), "{} points, the model has {}", points.cols(),
                  model.mean.cols());
  if (!points.allFinite() || shape_size(points) < 1) return 0;
  workspace.compressed.resize(model.stage.weights.cols());
  features_at(model, gray, points, workspace, workspace.compressed.data());
  const double value = static_cast<double>(model.stage.weights.row(0) * workspace.compressed) +
                       static_cast<double>(model.stage.bias[0]);
  return std::clamp(value, 0.0, 1.0);
}

}  // namespace tarsier::face::regression
