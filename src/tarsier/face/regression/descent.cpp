// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/descent.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/face/shape/similarity.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::regression {

void DescentOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!stages.empty() && stages.size() <= 20, "{} stages", stages.size());
  for (const FeatureScale& scale : stages) scale.check();
}

void Descent::check() const {
  const Eigen::Index n = mean.cols();
  TARSIER_REQUIRE(n >= 2 && mean.allFinite(), "{} points", n);
  TARSIER_REQUIRE(!stages.empty(), "no stages");
  for (const Stage& stage : stages) {
    const Eigen::Index d = stage.components.cols();
    TARSIER_REQUIRE(stage.center.size() == kDescriptor && stage.components.rows() == kDescriptor,
                    "a descriptor has {} numbers", kDescriptor);
    TARSIER_REQUIRE(stage.weights.rows() == 2 * n && stage.weights.cols() == n * d,
                    "weights are {} x {}", stage.weights.rows(), stage.weights.cols());
    TARSIER_REQUIRE(stage.bias.size() == 2 * n, "bias has {} numbers", stage.bias.size());
  }
}

Reduced reduce_around(const cv::Mat& gray, const Eigen::Matrix2Xd& points, double px_per_unit) {
  require_gray(gray);
  const double size = shape_size(points);
  TARSIER_REQUIRE(size > 0 && std::isfinite(size), "a shape without extent");
  Reduced reduced;
  const double factor = size / (1.5 * px_per_unit);
  if (factor <= 1) {
    reduced.gray = gray;
    return reduced;
  }
  // Large enough for the largest cells around an inaccurate start.
  const double margin = 2.2 * size;
  const Eigen::Vector2d low = points.rowwise().minCoeff().array() - margin;
  const Eigen::Vector2d high = points.rowwise().maxCoeff().array() + margin;
  const cv::Rect area =
      cv::Rect(cv::Point(static_cast<int>(std::max(0.0, std::floor(low.x()))),
                         static_cast<int>(std::max(0.0, std::floor(low.y())))),
               cv::Point(static_cast<int>(std::clamp(std::ceil(high.x()), 0.0, 1e6)),
                         static_cast<int>(std::clamp(std::ceil(high.y()), 0.0, 1e6)))) &
      cv::Rect(0, 0, gray.cols, gray.rows);
  if (area.width < 2 || area.height < 2) {
    reduced.gray = gray;
    return reduced;
  }
  const cv::Size target(std::max(1, static_cast<int>(std::lround(area.width / factor))),
                        std::max(1, static_cast<int>(std::lround(area.height / factor))));
  // Use the same factor for x and y, so that the inverse is a similarity. The reduced part of the
  // image has a size of whole pixels.
  const double scale = std::max(static_cast<double>(area.width) / target.width,
                                static_cast<double>(area.height) / target.height);
  cv::Mat map = (cv::Mat_<double>(2, 3) << scale, 0, area.x + 0.5 * scale - 0.5, 0, scale,
                 area.y + 0.5 * scale - 0.5);
  if (scale < 2) {
    cv::warpAffine(gray, reduced.gray, map, target, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                   cv::BORDER_REPLICATE);
    reduced.scale = scale;
    reduced.offset = {map.at<double>(0, 2), map.at<double>(1, 2)};
    return reduced;
  }
  // Average whole pixels first.
  const int whole = static_cast<int>(scale);
  cv::Rect even = area;
  even.width -= even.width % whole;
  even.height -= even.height % whole;
  cv::resize(gray(even), reduced.gray, even.size() / whole, 0, 0, cv::INTER_AREA);
  reduced.scale = whole;
  reduced.offset = {even.x + 0.5 * whole - 0.5, even.y + 0.5 * whole - 0.5};
  return reduced;
}

void stage_features(const Descent::Stage& stage, const Eigen::Matrix2Xd& mean, const cv::Mat& gray,
                    const Eigen::Matrix2Xd& points, DescentWorkspace& workspace, float* out) {
  const shape::Similarity2d upright = shape::fit_similarity(points, mean);
  Eigen::Matrix<double, 2, 3> map;
  map << upright.a, -upright.b, upright.tx, upright.b, upright.a, upright.ty;
  const Eigen::Index n = points.cols();
  workspace.descriptors.resize(static_cast<std::size_t>(n) * kDescriptor);
  gradient_features(gray, map, points, stage.scale, workspace.features,
                    workspace.descriptors.data());
  Eigen::Map<Eigen::MatrixXf> descriptors(workspace.descriptors.data(), kDescriptor, n);
  descriptors.colwise() -= stage.center;
  Eigen::Map<Eigen::MatrixXf> to(out, stage.components.cols(), n);
  to.noalias() = stage.components.transpose() * descriptors;
}

Eigen::Matrix2Xd fit_descent(const Descent& model, const cv::Mat& gray,
                             const Eigen::Matrix2Xd& start, DescentWorkspace& workspace) {
  TARSIER_REQUIRE(start.cols() == model.mean.cols(), "{} points, the model has {}", start.cols(),
                  model.mean.cols());
  double finest = 0;
  for (const Descent::Stage& stage : model.stages) {
    finest = std::max(finest, stage.scale.px_per_unit);
  }
  const Reduced reduced = reduce_around(gray, start, finest);
  Eigen::Matrix2Xd points = (start.colwise() - reduced.offset) / reduced.scale;
  for (const Descent::Stage& stage : model.stages) {
    workspace.compressed.resize(stage.weights.cols());
    stage_features(stage, model.mean, reduced.gray, points, workspace, workspace.compressed.data());
    workspace.step.noalias() = stage.weights * workspace.compressed;
    workspace.step += stage.bias;
    const shape::Similarity2d back = shape::fit_similarity(points, model.mean).inverse();
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      const double dx = workspace.step[2 * i];
      const double dy = workspace.step[2 * i + 1];
      points(0, i) += back.a * dx - back.b * dy;
      points(1, i) += back.b * dx + back.a * dy;
    }
    if (!points.allFinite() || shape_size(points) < 1) return start;
  }
  return (points * reduced.scale).colwise() + reduced.offset;
}

}  // namespace tarsier::face::regression
