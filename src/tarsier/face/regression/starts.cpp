// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/starts.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/shape/similarity.h"

#include <opencv2/core/cvdef.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <utility>

namespace tarsier::face::regression {

namespace {

// Standard deviations of starts.
constexpr double kStartShift = 0.09;  // shares of the size
constexpr double kStartScale = 0.10;  // of the logarithm
constexpr double kStartRotation = 10 * CV_PI / 180;

}  // namespace

Eigen::Matrix2Xd place_mean_shape(const Eigen::Matrix2Xd& mean, const Eigen::Vector2d& center,
                                  double size, double angle) {
  const shape::Similarity2d place{size * std::cos(angle), size * std::sin(angle), center.x(),
                                  center.y()};
  return place(mean);
}

std::vector<Start> scattered_starts(const std::vector<TrainingFace>& faces,
                                    const Eigen::Matrix2Xd& mean, int each, std::uint64_t seed,
                                    const std::vector<Eigen::Matrix2Xd>& detected) {
  TARSIER_REQUIRE(detected.empty() || detected.size() == faces.size(),
                  "{} detected shapes, {} faces", detected.size(), faces.size());
  std::vector<Start> starts;
  const Rng root(seed);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    Rng rng = root.fork(f);
    const Eigen::Vector2d center = faces[f].points.rowwise().mean();
    const double size = shape_size(faces[f].points);
    const bool is_detected = !detected.empty() && detected[f].cols() > 0;
    for (int k = 0; k < each; ++k) {
      Eigen::Vector2d around = center;
      double start_size = size;
      double spread = 1;
      if (is_detected && k % 2 == 1) {
        around = detected[f].rowwise().mean();
        start_size = shape_size(detected[f]);
        spread = 0.5;
      }
      const double angle = rng.normal(0, kStartRotation);
      const double scale = std::exp(rng.normal(0, kStartScale * spread));
      const double dx = rng.normal(0, kStartShift * spread);
      const double dy = rng.normal(0, kStartShift * spread);
      const Eigen::Vector2d to = around + start_size * Eigen::Vector2d(dx, dy);
      starts.push_back(
          {static_cast<int>(f), place_mean_shape(mean, to, start_size * scale, angle)});
    }
  }
  return starts;
}

std::vector<Start> shaped_starts(const std::vector<TrainingFace>& faces, const StartShapes& shapes,
                                 int each, std::uint64_t seed, const std::stop_token& stop) {
  std::vector<std::vector<Eigen::Matrix2Xd>> placed(faces.size());
  const Rng root = Rng(seed).fork(77);
  cv::parallel_for_(cv::Range(0, static_cast<int>(faces.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto f = static_cast<std::size_t>(i);
      Rng rng = root.fork(f);
      for (const Eigen::Matrix2Xd& shape : shapes(faces[f], each, rng())) {
        TARSIER_REQUIRE(shape.cols() == faces[f].points.cols() && shape.allFinite(),
                        "{}: a start of {} points, expected {} finite ones", faces[f].name,
                        shape.cols(), faces[f].points.cols());
        const Eigen::Vector2d center = shape.rowwise().mean();
        const double angle = rng.normal(0, kStartRotation / 4);
        const double scale = std::exp(rng.normal(0, kStartScale / 2));
        const double dx = rng.normal(0, kStartShift / 2);
        const double dy = rng.normal(0, kStartShift / 2);
        const Eigen::Vector2d to = center + shape_size(shape) * Eigen::Vector2d(dx, dy);
        const shape::Similarity2d similarity{scale * std::cos(angle), scale * std::sin(angle), 0,
                                             0};
        placed[f].emplace_back(similarity(Eigen::Matrix2Xd(shape.colwise() - center)).colwise() +
                               to);
      }
    }
  });
  throw_if_stopped(stop);
  std::vector<Start> starts;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (Eigen::Matrix2Xd& shape : placed[f])
      starts.push_back({static_cast<int>(f), std::move(shape)});
  }
  return starts;
}

}  // namespace tarsier::face::regression
