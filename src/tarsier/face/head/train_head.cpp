// SPDX-License-Identifier: MIT
#include "tarsier/face/head/train_head.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/head/head_trainer.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::face::head {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

HeadModel model_of(const HeadTrainer& trainer) {
  HeadModel model;
  model.mean = trainer.mean;
  // Make both sides exactly symmetric.
  for (Index i = 0; i < trainer.n; ++i) {
    const Index other = trainer.markup.mirror[static_cast<std::size_t>(i)];
    if (other > i) model.mean.col(other) = Vector3d(-1, 1, 1).cwiseProduct(model.mean.col(i));
    if (other == i) model.mean(0, i) = 0;
  }
  model.modes.resize(3 * trainer.n, 0);
  if (trainer.m > 0) {
    const linalg::LeftSvd svd = linalg::left_svd(trainer.modes);
    // Few or similar faces have fewer modes: the others are rounding errors, which are not
    // symmetric.
    const Index kept = (svd.values.array() > 1e-9 * svd.values[0]).count();
    model.modes = svd.u.leftCols(kept);
    model.deviation = svd.values.head(kept);
  }
  model.mirror = trainer.markup.mirror;
  model.outer_eyes = trainer.markup.outer_eyes;
  model.connections = trainer.markup.connections;
  model.landmark.resize(static_cast<std::size_t>(trainer.n));
  std::iota(model.landmark.begin(), model.landmark.end(), 0);
  for (std::size_t i = 0; i < trainer.is_outline.size(); ++i)
    if (trainer.is_outline[i] != 0) model.outline.push_back(static_cast<int>(i));
  model.trained_on = static_cast<int>(trainer.views.size());
  return model;
}

// Rotates the head about x so that the median face has pitch 0.
void set_median_pitch_to_zero(HeadTrainer& trainer) {
  std::vector<double> pitches;
  pitches.reserve(trainer.views.size());
  for (const TrainingView& view : trainer.views)
    pitches.push_back(angles_of_rotation(view.camera.rotation).pitch_deg);
  const auto median = pitches.begin() + static_cast<std::ptrdiff_t>(pitches.size() / 2);
  std::nth_element(pitches.begin(), median, pitches.end());
  const Matrix3d rotation = rotation_of_angles({0, *median, 0});
  trainer.mean = rotation * trainer.mean;
  for (Index i = 0; i < trainer.n; ++i)
    trainer.modes.middleRows(3 * i, 3) = rotation * trainer.modes.middleRows(3 * i, 3).eval();
  for (TrainingView& view : trainer.views)
    view.camera.rotation = view.camera.rotation * rotation.transpose();
}

}  // namespace

TrainedHead train_head(const std::vector<Matrix2Xd>& faces, const shape::Markup& markup,
                       const TrainHeadOptions& options, Progress* progress,
                       const std::stop_token& stop) {
  options.check();
  HeadTrainer trainer{options, markup, {}, {}, {}, {}, {}};
  trainer.n = static_cast<Index>(markup.mirror.size());
  const Index n = trainer.n;
  TARSIER_REQUIRE(n >= 4, "a markup of {} points", n);
  for (const int eye : markup.outer_eyes)
    TARSIER_REQUIRE(eye >= 0 && eye < n, "outer eye corner {} of {} points", eye, n);
  TARSIER_REQUIRE(
      markup.mirror[static_cast<std::size_t>(markup.outer_eyes[0])] == markup.outer_eyes[1],
      "the outer eye corners are not a pair");
  for (Index i = 0; i < n; ++i) {
    const int other = markup.mirror[static_cast<std::size_t>(i)];
    TARSIER_REQUIRE(other >= 0 && other < n && markup.mirror[static_cast<std::size_t>(other)] == i,
                    "the mirror of point {} is {}", i, other);
  }
  trainer.is_outline.assign(static_cast<std::size_t>(n), 0);
  std::vector<int> outline = options.outline;
  if (outline.empty() && n == 68) {
    outline.resize(17);
    std::iota(outline.begin(), outline.end(), 0);
  }
  for (const int i : outline) {
    TARSIER_REQUIRE(i >= 0 && i < n, "outline point {} of {}", i, n);
    trainer.is_outline[static_cast<std::size_t>(i)] = 1;
  }
  std::vector<std::size_t> used;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    TARSIER_REQUIRE(faces[f].cols() == n, "face {} has {} points, the markup {}", f,
                    faces[f].cols(), n);
    if (!faces[f].allFinite()) continue;
    const Matrix2Xd centred = faces[f].colwise() - faces[f].rowwise().mean();
    const double size = std::sqrt(centred.squaredNorm() / static_cast<double>(n));
    if (!(size > 0)) continue;
    TrainingView view;
    view.points = centred / size;
    view.moment = MatrixXd::Ones(1, 1);
    view.flat = view.points;
    view.visible = view.weight = VectorXd::Ones(n);
    view.squared = VectorXd::Zero(n);
    trainer.views.push_back(std::move(view));
    used.push_back(f);
  }
  TARSIER_REQUIRE(used.size() >= 10, "{} complete faces", used.size());

  trainer.start();
  // The rigid head first; modes are added when the poses are approximately known.
  const int rigid_iterations = std::min(10, options.iterations / 2);
  if (progress != nullptr) progress->begin("head", options.iterations, "iterations");
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    throw_if_stopped(stop);
    if (iteration == rigid_iterations && options.modes > 0) {
      trainer.m = options.modes;
      trainer.modes.resize(3 * n, trainer.m);
      Rng rng(options.seed);
      for (Index k = 0; k < trainer.m; ++k) {
        for (Index i = 0; i < n; ++i) {
          const Index other = markup.mirror[static_cast<std::size_t>(i)];
          for (Index c = 0; c < 3; ++c) {
            const double value = rng.normal();
            if (other < i) continue;
            trainer.modes(3 * i + c, k) = value;
            trainer.modes(3 * other + c, k) = c == 0 ? -value : value;
            if (other == i && c == 0) trainer.modes(3 * i, k) = 0;
          }
        }
      }
      for (TrainingView& view : trainer.views) view.b = VectorXd::Zero(trainer.m);
    }
    cv::parallel_for_(cv::Range(0, static_cast<int>(trainer.views.size())),
                      [&](const cv::Range& range) {
                        for (int f = range.start; f < range.end; ++f) {
                          TrainingView& view = trainer.views[static_cast<std::size_t>(f)];
                          trainer.update_visibility(view);
                          trainer.estimate(view, 2);
                        }
                      });
    trainer.update_noise();
    trainer.update_shape();
    trainer.fix_gauge();
    if (progress != nullptr) progress->advance();
  }
  set_median_pitch_to_zero(trainer);
  if (progress != nullptr) progress->end();

  TrainedHead result;
  result.model = model_of(trainer);
  result.angles.resize(faces.size());
  double sum = 0;
  double weight = 0;
  double scale = 0;
  for (std::size_t f = 0; f < used.size(); ++f) {
    const TrainingView& view = trainer.views[f];
    result.angles[used[f]] = angles_of_rotation(view.camera.rotation);
    scale += view.camera.scale / static_cast<double>(used.size());
    sum += view.weight.dot(view.squared) / (view.camera.scale * view.camera.scale);
    weight += 2 * view.weight.sum();
  }
  result.model.noise = trainer.noise / scale;
  result.model.check();
  result.rms_mm = std::sqrt(sum / weight);
  return result;
}

double aligned_error(const Matrix3Xd& shape, const Matrix3Xd& truth,
                     const std::vector<int>& points) {
  TARSIER_REQUIRE(shape.cols() == truth.cols() && shape.cols() >= 3, "shapes of {} and {} points",
                  shape.cols(), truth.cols());
  const auto truth_from_shape = geometry::similarity_between(shape, truth);
  TARSIER_REQUIRE(truth_from_shape, "points on a line");
  std::vector<int> all = points;
  if (all.empty()) {
    all.resize(static_cast<std::size_t>(shape.cols()));
    std::iota(all.begin(), all.end(), 0);
  }
  double sum = 0;
  for (const int i : all) {
    TARSIER_REQUIRE(i >= 0 && i < shape.cols(), "point {} of {}", i, shape.cols());
    sum += (*truth_from_shape * shape.col(i) - truth.col(i)).norm();
  }
  return sum / static_cast<double>(all.size());
}

}  // namespace tarsier::face::head
