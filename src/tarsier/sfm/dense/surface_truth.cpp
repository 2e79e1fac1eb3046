// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/surface_truth.h"

#include "tarsier/core/statistics.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

constexpr double kMaxDepthDifference = 0.01;
constexpr double kTrimmedShare = 0.005;  // share of the points on each side

constexpr double kThresholds[] = {0.0025, 0.005, 0.01};

}  // namespace

Eigen::Vector3d GroundTruthView::world_of(int x, int y) const {
  const double z = depth(y, x);
  return pose.rotation.transpose() *
         (Eigen::Vector3d((x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z) -
          pose.translation);
}

bool GroundTruthView::sees(const Eigen::Vector3d& world) const {
  const Eigen::Vector3d there = pose * world;
  const auto pixel = camera.project(there);
  if (!pixel || !(pixel->x > -0.5 && pixel->y > -0.5 && pixel->x < camera.width - 0.5 &&
                  pixel->y < camera.height - 0.5))
    return false;
  const float z =
      depth(static_cast<int>(std::lround(pixel->y)), static_cast<int>(std::lround(pixel->x)));
  return z > 0 && std::abs(z / there.z() - 1) < kMaxDepthDifference;
}

GroundTruthView ground_truth_view(const Workspace& workspace, int index) {
  GroundTruthView view;
  view.depth = workspace.read_depth_map(index).depth;
  view.camera = camera_of_map(workspace.camera(index), view.depth.size());
  view.pose = workspace.pose(index);
  return view;
}

double share_within(const std::vector<float>& values, double limit) {
  if (values.empty()) return 0;
  const auto count =
      std::count_if(values.begin(), values.end(), [&](float value) { return value <= limit; });
  return static_cast<double>(count) / static_cast<double>(values.size());
}

float distance_limit(double extent) { return static_cast<float>(1.01 * kThresholds[2] * extent); }

float distance_cell(double extent) { return static_cast<float>(kThresholds[0] * extent); }

std::vector<ThresholdScore> score_thresholds(const std::vector<float>& accuracy_distances,
                                             const std::vector<float>& completeness_distances,
                                             double extent) {
  std::vector<ThresholdScore> scores;
  for (const double threshold : kThresholds) {
    ThresholdScore score;
    score.threshold = threshold;
    score.accuracy = share_within(accuracy_distances, threshold * extent);
    score.completeness = share_within(completeness_distances, threshold * extent);
    const double sum = score.accuracy + score.completeness;
    score.f1 = sum > 0 ? 2 * score.accuracy * score.completeness / sum : 0;
    scores.push_back(score);
  }
  return scores;
}

nlohmann::ordered_json to_json(const std::vector<ThresholdScore>& scores) {
  const auto rounded = [](double value) { return std::round(value * 1e6) / 1e6; };
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ThresholdScore& one : scores) {
    list.push_back({{"threshold", one.threshold},
                    {"accuracy", rounded(one.accuracy)},
                    {"completeness", rounded(one.completeness)},
                    {"f1", rounded(one.f1)}});
  }
  return list;
}

double extent_of(const std::vector<cv::Vec3f>& points) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) {
    std::vector<float> values;
    values.reserve(points.size());
    for (const cv::Vec3f& point : points) values.push_back(point[k]);
    const double high = lower_quantile(values, 1 - kTrimmedShare);
    const double low = lower_quantile(values, kTrimmedShare);
    const double side = high - low;
    sum += side * side;
  }
  return std::sqrt(sum);
}

}  // namespace tarsier::sfm
