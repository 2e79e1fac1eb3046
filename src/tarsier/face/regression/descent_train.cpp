// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/least_squares.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>

namespace tarsier::face::regression {

namespace {

struct ReducedStart {
  int face = 0;
  Eigen::Matrix2Xd points;  // px of the reduced face
};

// The faces at the resolution of the finest stage.
struct ReducedFace {
  cv::Mat gray;
  Eigen::Matrix2Xd points;
  Reduced reduced;
};

// Moves the points by a step in the frame of the mean.
void move(Eigen::Matrix2Xd& points, const Eigen::Matrix2Xd& mean, const float* step) {
  const shape::Similarity2d back = shape::fit_similarity(points, mean).inverse();
  Eigen::Matrix2Xd moved = points;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const double dx = step[2 * i];
    const double dy = step[2 * i + 1];
    moved(0, i) += back.a * dx - back.b * dy;
    moved(1, i) += back.b * dx + back.a * dy;
  }
  if (moved.allFinite() && shape_size(moved) > 1) points = moved;
}

// Half the difference between the mean x errors of unmirrored and mirrored faces.
double shift_of_mirrored(const std::vector<TrainingFace>& faces,
                         const std::vector<ReducedFace>& reduced,
                         const std::vector<ReducedStart>& samples) {
  double sums[2] = {};
  int counts[2] = {};
  for (const ReducedStart& sample : samples) {
    const auto f = static_cast<std::size_t>(sample.face);
    const ReducedFace& face = reduced[f];
    const int kind = faces[f].mirrored ? 1 : 0;
    sums[kind] += (face.points - sample.points).row(0).mean() * face.reduced.scale * faces[f].scale;
    ++counts[kind];
  }
  if (counts[0] == 0 || counts[1] == 0) return 0;
  return 0.5 * (sums[0] / counts[0] - sums[1] / counts[1]);
}

}  // namespace

void compress_descriptors(Descent::Stage& stage, const FeatureScale& scale, int components,
                          const Eigen::Matrix2Xd& mean, const std::vector<const cv::Mat*>& images,
                          const std::vector<Eigen::Matrix2Xd>& points) {
  TARSIER_REQUIRE(components >= 1 && components <= kDescriptor, "{} components", components);
  TARSIER_REQUIRE(!images.empty() && images.size() == points.size(), "{} images, {} shapes",
                  images.size(), points.size());
  // A few hundred faces are enough for a 128 x 128 covariance.
  const std::size_t step = std::max<std::size_t>(1, images.size() / 600);
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(kDescriptor);
  Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(kDescriptor, kDescriptor);
  double count = 0;
  Descent::Stage plain;
  plain.scale = scale;
  plain.center = Eigen::VectorXf::Zero(kDescriptor);
  plain.components = Eigen::MatrixXf::Identity(kDescriptor, kDescriptor);
  DescentWorkspace workspace;
  Eigen::MatrixXf descriptors(kDescriptor, mean.cols());
  for (std::size_t i = 0; i < images.size(); i += step) {
    stage_features(plain, mean, *images[i], points[i], workspace, descriptors.data());
    const Eigen::MatrixXd exact = descriptors.cast<double>();
    sum += exact.rowwise().sum();
    squares.noalias() += exact * exact.transpose();
    count += static_cast<double>(mean.cols());
  }
  const Eigen::VectorXd center = sum / count;
  const Eigen::MatrixXd covariance = squares / count - center * center.transpose();
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(covariance);
  stage.scale = scale;
  stage.center = center.cast<float>();
  stage.components = eigen.vectors.rightCols(components).rowwise().reverse().cast<float>();
  // The sign of an eigenvector is arbitrary. Make its largest element positive, so that all
  // machines agree.
  for (Eigen::Index c = 0; c < stage.components.cols(); ++c) {
    Eigen::Index index = 0;
    stage.components.col(c).cwiseAbs().maxCoeff(&index);
    if (stage.components(index, c) < 0) stage.components.col(c) *= -1;
  }
}

Descent train_descent(const std::vector<TrainingFace>& faces, const std::vector<Start>& starts,
                      const DescentOptions& options, Progress& progress,
                      const std::stop_token& stop, DescentReport* report) {
  options.check();
  TARSIER_REQUIRE(!faces.empty() && !starts.empty(), "{} faces, {} starts", faces.size(),
                  starts.size());
  double finest = 0;
  for (const FeatureScale& scale : options.stages) finest = std::max(finest, scale.px_per_unit);

  Descent model;
  {
    std::vector<Eigen::Matrix2Xd> shapes;
    shapes.reserve(faces.size());
    for (const TrainingFace& face : faces) shapes.push_back(face.points);
    shape::ShapeModelOptions shape_options;
    if (shapes.size() < 2) shapes.push_back(shapes.front());
    model.mean = shape::train_shape_model(shapes, shape_options).mean;
  }
  const int n = model.points();
  std::vector<ReducedFace> reduced(faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    ReducedFace& to = reduced[f];
    to.reduced = reduce_around(faces[f].gray, faces[f].points, finest);
    to.gray = to.reduced.gray;
    to.points = (faces[f].points.colwise() - to.reduced.offset) / to.reduced.scale;
  }

  // A face and the faces made from it are in the same part; a part's samples are contiguous.
  const int folds = std::min<int>(options.folds, static_cast<int>(faces.size()));
  std::vector<int> fold_of(faces.size());
  Rng rng(options.seed);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    fold_of[f] = f > 0 && (faces[f].mirrored || faces[f].turned) ? fold_of[f - 1]
                                                                 : rng.integer(0, folds - 1);
  }
  std::vector<ReducedStart> samples;
  std::vector<int> begin(static_cast<std::size_t>(folds) + 1, 0);
  for (int fold = 0; fold < folds; ++fold) {
    for (const Start& start : starts) {
      TARSIER_REQUIRE(start.face >= 0 && start.face < static_cast<int>(faces.size()) &&
                          start.points.cols() == n,
                      "start of face {} with {} points", start.face, start.points.cols());
      const auto f = static_cast<std::size_t>(start.face);
      if (fold_of[f] != fold) continue;
      const Reduced& to = reduced[f].reduced;
      samples.push_back({start.face, (start.points.colwise() - to.offset) / to.scale});
    }
    begin[static_cast<std::size_t>(fold) + 1] = static_cast<int>(samples.size());
  }
  const int count = static_cast<int>(samples.size());

  progress.begin("descent", static_cast<std::int64_t>(options.stages.size()) * count, "faces");
  for (const FeatureScale& scale : options.stages) {
    throw_if_stopped(stop);
    Descent::Stage stage;
    {
      std::vector<const cv::Mat*> images;
      std::vector<Eigen::Matrix2Xd> points;
      for (const ReducedStart& sample : samples) {
        images.push_back(&reduced[static_cast<std::size_t>(sample.face)].gray);
        points.push_back(sample.points);
      }
      compress_descriptors(stage, scale, options.components, model.mean, images, points);
    }

    Rows features;
    features.columns = n * options.components + 1;
    features.values.resize(static_cast<std::size_t>(count) *
                           static_cast<std::size_t>(features.columns));
    Rows targets;
    targets.columns = 2 * n;
    targets.values.resize(static_cast<std::size_t>(count) *
                          static_cast<std::size_t>(targets.columns));
    std::atomic<bool> stopped = false;
    cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
      DescentWorkspace workspace;
      for (int i = range.start; i < range.end && !stopped; ++i) {
        if (stop.stop_requested()) stopped = true;
        const ReducedStart& sample = samples[static_cast<std::size_t>(i)];
        const ReducedFace& face = reduced[static_cast<std::size_t>(sample.face)];
        stage_features(stage, model.mean, face.gray, sample.points, workspace, features.row(i));
        features.row(i)[features.columns - 1] = 1;
        const shape::Similarity2d upright = shape::fit_similarity(sample.points, model.mean);
        const Eigen::Matrix2Xd difference = face.points - sample.points;
        float* target = targets.row(i);
        for (int p = 0; p < n; ++p) {
          target[2 * p] =
              static_cast<float>(upright.a * difference(0, p) - upright.b * difference(1, p));
          target[2 * p + 1] =
              static_cast<float>(upright.b * difference(0, p) + upright.a * difference(1, p));
        }
        progress.advance();
      }
    });
    throw_if_stopped(stop);

    std::vector<Eigen::MatrixXf> squares;
    std::vector<Eigen::MatrixXf> products;
    for (std::size_t fold = 0; fold < static_cast<std::size_t>(folds); ++fold) {
      squares.push_back(cross_products(features, features, begin[fold], begin[fold + 1]));
      products.push_back(cross_products(features, targets, begin[fold], begin[fold + 1]));
      throw_if_stopped(stop);
    }
    Eigen::MatrixXf all_squares = squares[0];
    Eigen::MatrixXf all_products = products[0];
    for (std::size_t fold = 1; fold < squares.size(); ++fold) {
      all_squares += squares[fold];
      all_products += products[fold];
    }
    const float mean_square = all_squares.diagonal().head(features.columns - 1).sum() /
                              static_cast<float>(features.columns - 1);
    const float lambda = static_cast<float>(options.ridge) * mean_square;
    std::vector<Eigen::MatrixXf> solutions(static_cast<std::size_t>(folds) + 1);
    cv::parallel_for_(cv::Range(0, folds + 1), [&](const cv::Range& range) {
      for (int k = range.start; k < range.end; ++k) {
        const auto fold = static_cast<std::size_t>(k);
        if (k == folds) {
          solutions[fold] = ridge(all_squares, all_products, lambda);
          continue;
        }
        solutions[fold] = ridge(all_squares - squares[fold], all_products - products[fold], lambda);
      }
    });
    throw_if_stopped(stop);
    const Eigen::MatrixXf& kept = solutions.back();
    stage.weights = kept.topRows(features.columns - 1).transpose();
    stage.bias = kept.bottomRows(1).transpose();

    std::vector<double> errors(samples.size());  // of each sample when it was held out
    cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
      Eigen::VectorXf step(2 * n);
      for (int i = range.start; i < range.end; ++i) {
        ReducedStart& sample = samples[static_cast<std::size_t>(i)];
        const auto fold = static_cast<std::size_t>(fold_of[static_cast<std::size_t>(sample.face)]);
        const Eigen::Map<const Eigen::VectorXf> row(features.row(i), features.columns);
        step.noalias() = solutions[fold].transpose() * row;
        const Eigen::Map<const Eigen::VectorXf> target(targets.row(i), targets.columns);
        errors[static_cast<std::size_t>(i)] = static_cast<double>((target - step).squaredNorm());
        move(sample.points, model.mean, step.data());
      }
    });
    if (report != nullptr) {
      const double error = std::accumulate(errors.begin(), errors.end(), 0.0);
      report->errors.push_back(std::sqrt(error / (static_cast<double>(count) * n)));
    }
    model.stages.push_back(std::move(stage));
  }
  if (report != nullptr) report->to_the_right = shift_of_mirrored(faces, reduced, samples);
  progress.end();
  return model;
}

}  // namespace tarsier::face::regression
