// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/landmarks/adapt.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::landmarks {

namespace {

constexpr int kMaxParts = 5;  // of the images, for cross-fitting

// The dual variables A = (K + lambda)^-1 E.
Eigen::MatrixXd dual(Eigen::MatrixXd kernel, const Eigen::MatrixXd& errors, double lambda) {
  kernel.diagonal().array() += lambda;
  return linalg::solve_symmetric(kernel, errors);
}

// Scales the caller's value by the starts per image and the mean norm of a row.
double lambda_of(double ridge, const Eigen::MatrixXd& kernel, std::size_t faces) {
  const double starts = static_cast<double>(kernel.rows()) / static_cast<double>(faces);
  return ridge * starts * std::max(1e-9, kernel.diagonal().mean());
}

void check(const std::vector<regression::TrainingFace>& faces,
           const std::vector<regression::Start>& starts, Eigen::Index points, double ridge) {
  TARSIER_REQUIRE(!faces.empty() && !starts.empty(), "{} faces, {} starts", faces.size(),
                  starts.size());
  TARSIER_REQUIRE(ridge > 0 && ridge <= 1e6, "ridge is in (0, 1e6], got {}", ridge);
  for (const regression::Start& start : starts) {
    TARSIER_REQUIRE(start.face >= 0 && start.face < static_cast<int>(faces.size()) &&
                        start.points.cols() == points,
                    "start of face {} with {} points, the model has {}", start.face,
                    start.points.cols(), points);
  }
}

// Steps in the frame of the mean as one row: x0 y0 x1 ..
void set_step_row(const shape::Similarity2d& upright, const Eigen::Matrix2Xd& difference,
                  Eigen::Ref<Eigen::RowVectorXd> row) {
  for (Eigen::Index p = 0; p < difference.cols(); ++p) {
    row[2 * p] = upright.a * difference(0, p) - upright.b * difference(1, p);
    row[2 * p + 1] = upright.b * difference(0, p) + upright.a * difference(1, p);
  }
}

// A start at the resolution of the finest stage.
struct Sample {
  int face = 0;
  cv::Mat gray;
  Eigen::Matrix2Xd truth;
  Eigen::Matrix2Xd points;
};

std::vector<Sample> reduced_samples(const regression::Descent& base,
                                    const std::vector<regression::TrainingFace>& faces,
                                    const std::vector<regression::Start>& starts) {
  double finest = 0;
  for (const regression::Descent::Stage& stage : base.stages) {
    finest = std::max(finest, stage.scale.px_per_unit);
  }
  std::vector<regression::Reduced> reduced;
  reduced.reserve(faces.size());
  for (const regression::TrainingFace& face : faces) {
    reduced.push_back(regression::reduce_around(face.gray, face.points, finest));
  }
  std::vector<Sample> samples;
  for (const regression::Start& start : starts) {
    const auto f = static_cast<std::size_t>(start.face);
    const regression::Reduced& to = reduced[f];
    samples.push_back({start.face, to.gray, (faces[f].points.colwise() - to.offset) / to.scale,
                       (start.points.colwise() - to.offset) / to.scale});
  }
  return samples;
}

// Rows of features with the constant last, and the residuals of the steps after R0.
struct RidgeProblem {
  Eigen::MatrixXd features;
  Eigen::MatrixXd base_steps;
  Eigen::MatrixXd errors;
  double constant = 1;
};

RidgeProblem problem_of(const regression::Descent::Stage& stage, const Eigen::Matrix2Xd& mean,
                        const std::vector<Sample>& samples, const std::stop_token& stop) {
  const auto count = static_cast<Eigen::Index>(samples.size());
  const Eigen::Index width = stage.weights.cols();
  RidgeProblem problem;
  problem.features.resize(count, width + 1);
  problem.base_steps.resize(count, stage.weights.rows());
  problem.errors.resize(count, stage.weights.rows());
  cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
    regression::DescentWorkspace workspace;
    Eigen::VectorXf features(width);
    Eigen::RowVectorXd step(stage.weights.rows());
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const Sample& sample = samples[static_cast<std::size_t>(i)];
      regression::stage_features(stage, mean, sample.gray, sample.points, workspace,
                                 features.data());
      problem.features.row(i).head(width) = features.cast<double>().transpose();
      problem.base_steps.row(i) =
          (stage.weights * features + stage.bias).cast<double>().transpose();
      set_step_row(shape::fit_similarity(sample.points, mean), sample.truth - sample.points, step);
      problem.errors.row(i) = step - problem.base_steps.row(i);
    }
  });
  throw_if_stopped(stop);
  // The constant has the weight of all features together, so that the common offset of a person's
  // points is learned first.
  problem.constant = std::sqrt(
      std::max(1e-9, problem.features.leftCols(width).squaredNorm() / static_cast<double>(count)));
  problem.features.col(width).setConstant(problem.constant);
  return problem;
}

void move_sample(Sample& sample, const Eigen::Matrix2Xd& mean, const Eigen::RowVectorXd& step) {
  const shape::Similarity2d back = shape::fit_similarity(sample.points, mean).inverse();
  Eigen::Matrix2Xd moved = sample.points;
  for (Eigen::Index p = 0; p < moved.cols(); ++p) {
    moved(0, p) += back.a * step[2 * p] - back.b * step[2 * p + 1];
    moved(1, p) += back.b * step[2 * p] + back.a * step[2 * p + 1];
  }
  if (moved.allFinite() && regression::shape_size(moved) > 1) sample.points = moved;
}

// Moves the samples of each part by a regression that was trained on the other parts. For a single
// image, its starts are divided into parts. If the base moved these samples, each stage would learn
// the person's whole offset again.
void move_samples(std::vector<Sample>& samples, const Eigen::Matrix2Xd& mean,
                  const RidgeProblem& problem, const Eigen::MatrixXd& kernel, double lambda,
                  int faces) {
  const int parts = faces > 1 ? std::min(faces, kMaxParts) : 2;
  for (int part = 0; part < parts; ++part) {
    std::vector<Eigen::Index> own;
    std::vector<Eigen::Index> others;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const int of = faces > 1 ? samples[i].face : static_cast<int>(i);
      (of % parts == part ? own : others).push_back(static_cast<Eigen::Index>(i));
    }
    Eigen::MatrixXd learned =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(own.size()), problem.errors.cols());
    if (!others.empty()) {
      const Eigen::MatrixXd errors = problem.errors(others, Eigen::all);
      const Eigen::MatrixXd likeness = kernel(own, others);
      learned = likeness * dual(kernel(others, others), errors, lambda);
    }
    for (std::size_t k = 0; k < own.size(); ++k) {
      move_sample(samples[static_cast<std::size_t>(own[k])], mean,
                  problem.base_steps.row(own[k]) + learned.row(static_cast<Eigen::Index>(k)));
    }
  }
}

}  // namespace

regression::Descent adapt_descent(const regression::Descent& base,
                                  const std::vector<regression::TrainingFace>& faces,
                                  const std::vector<regression::Start>& starts, double ridge,
                                  const std::stop_token& stop) {
  check(faces, starts, base.mean.cols(), ridge);
  regression::Descent model = base;
  std::vector<Sample> samples = reduced_samples(base, faces, starts);
  for (regression::Descent::Stage& stage : model.stages) {
    throw_if_stopped(stop);
    const RidgeProblem problem = problem_of(stage, model.mean, samples, stop);
    const Eigen::MatrixXd kernel = problem.features * problem.features.transpose();
    const double lambda = lambda_of(ridge, kernel, faces.size());
    const Eigen::MatrixXd change =
        problem.features.transpose() * dual(kernel, problem.errors, lambda);
    move_samples(samples, model.mean, problem, kernel, lambda, static_cast<int>(faces.size()));
    const Eigen::Index width = stage.weights.cols();
    stage.weights += change.topRows(width).transpose().cast<float>();
    stage.bias += (problem.constant * change.row(width)).transpose().cast<float>();
  }
  return model;
}

regression::RegressionNetwork adapt_network(const regression::RegressionNetwork& base,
                                            const std::vector<regression::TrainingFace>& faces,
                                            const std::vector<regression::Start>& starts,
                                            double ridge, const std::stop_token& stop) {
  check(faces, starts, base.mean.cols(), ridge);
  regression::RegressionNetwork model = base;
  linalg::Layer& last = model.network.layers.back();
  const auto count = static_cast<Eigen::Index>(starts.size());
  const auto width = static_cast<Eigen::Index>(last.depth());
  const Eigen::Index n = base.mean.cols();
  Eigen::MatrixXd features(count, width + 1);
  Eigen::MatrixXd errors(count, 2 * n);
  cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
    regression::RegressionNetworkWorkspace workspace;
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const regression::Start& start = starts[static_cast<std::size_t>(i)];
      const regression::TrainingFace& face = faces[static_cast<std::size_t>(start.face)];
      const Eigen::Matrix2Xd fit =
          regression::fit_network(base, face.gray, start.points, workspace);
      const std::vector<float>& seen = *(workspace.network.maps.end() - 2);
      features.row(i).head(width) =
          Eigen::Map<const Eigen::RowVectorXf>(seen.data(), width).cast<double>();
      const shape::Similarity2d mean_from_px =
          shape::fit_similarity(base.mean, start.points).inverse();
      const Eigen::Matrix2Xd difference = mean_from_px(face.points) - mean_from_px(fit);
      errors.row(i) << difference.row(0), difference.row(1);
    }
  });
  throw_if_stopped(stop);
  // As in problem_of().
  const double constant = std::sqrt(
      std::max(1e-9, features.leftCols(width).squaredNorm() / static_cast<double>(count)));
  features.col(width).setConstant(constant);
  const Eigen::MatrixXd kernel = features * features.transpose();
  const Eigen::MatrixXd change =
      features.transpose() * dual(kernel, errors, lambda_of(ridge, kernel, faces.size()));
  using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Eigen::Map<RowMajor>(last.weights.data(), 2 * n, width) +=
      change.topRows(width).transpose().cast<float>();
  Eigen::Map<Eigen::VectorXf>(last.bias.data(), 2 * n) +=
      (constant * change.row(width)).transpose().cast<float>();
  linalg::round_to_half(model.network);  // as it will be stored
  return model;
}

namespace {

// Leaves of the last level that each start reaches, and the remaining residuals to its true points.
struct ReachedLeaves {
  std::vector<std::vector<int>> leaves;
  Eigen::MatrixXd errors;
};

ReachedLeaves reached_leaves(const regression::Trees& base,
                             const std::vector<regression::TrainingFace>& faces,
                             const std::vector<regression::Start>& starts,
                             const std::stop_token& stop) {
  ReachedLeaves reached;
  reached.leaves.resize(starts.size());
  reached.errors.resize(static_cast<Eigen::Index>(starts.size()), 2 * base.mean.cols());
  cv::parallel_for_(cv::Range(0, static_cast<int>(starts.size())), [&](const cv::Range& range) {
    Eigen::RowVectorXd step(2 * base.mean.cols());
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const regression::Start& start = starts[static_cast<std::size_t>(i)];
      const regression::TrainingFace& face = faces[static_cast<std::size_t>(start.face)];
      const Eigen::Matrix2Xd fitted = regression::fit_trees(
          base, face.gray, start.points, &reached.leaves[static_cast<std::size_t>(i)]);
      set_step_row(shape::fit_similarity(base.mean, start.points).inverse(), face.points - fitted,
                   step);
      reached.errors.row(i) = step;
    }
  });
  throw_if_stopped(stop);
  return reached;
}

}  // namespace

regression::Trees adapt_trees(const regression::Trees& base,
                              const std::vector<regression::TrainingFace>& faces,
                              const std::vector<regression::Start>& starts, double ridge,
                              const std::stop_token& stop) {
  base.check();
  check(faces, starts, base.mean.cols(), ridge);
  const ReachedLeaves reached = reached_leaves(base, faces, starts, stop);
  const auto count = static_cast<Eigen::Index>(starts.size());
  const std::size_t trees = reached.leaves.front().size();
  // A start's row has ones at the leaves it reaches, so products of rows count common leaves. A
  // constant of the same weight is added, which is finally distributed over all leaves.
  Eigen::MatrixXd kernel(count, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index k = 0; k <= i; ++k) {
      const std::vector<int>& a = reached.leaves[static_cast<std::size_t>(i)];
      const std::vector<int>& b = reached.leaves[static_cast<std::size_t>(k)];
      double common = 0;
      for (std::size_t t = 0; t < trees; ++t) common += a[t] == b[t] ? 1 : 0;
      kernel(i, k) = kernel(k, i) = common + static_cast<double>(trees);
    }
  }
  const Eigen::MatrixXd solved =
      dual(kernel, reached.errors, lambda_of(ridge, kernel, faces.size()));
  regression::Trees model = base;
  regression::Trees::Level& last = model.levels.back();
  const Eigen::Index leaf_count = Eigen::Index{1} << base.depth;
  Eigen::MatrixXf moves = last.moves();
  moves.colwise() += solved.colwise().sum().transpose().cast<float>();
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const Eigen::VectorXf change =
        solved.row(static_cast<Eigen::Index>(i)).transpose().cast<float>();
    for (std::size_t t = 0; t < trees; ++t)
      moves.col(static_cast<Eigen::Index>(t) * leaf_count + reached.leaves[i][t]) += change;
  }
  last.set_leaves(moves, static_cast<int>(moves.rows()));
  return model;
}

}  // namespace tarsier::face::landmarks
