// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/sfm/surface/triangle_tree.h"

#include <Eigen/Geometry>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

constexpr double kSamples = 300'000;  // approximate number for each surface

Eigen::Vector3f to_eigen(const cv::Vec3f& v) { return {v[0], v[1], v[2]}; }

double area_of(const SurfaceMesh& mesh) { return measure_surface(mesh).area; }

std::vector<cv::Vec3f> samples_of(const SurfaceMesh& mesh) {
  return sample_surface(mesh, std::sqrt(area_of(mesh) / kSamples));
}

std::vector<float> distances(const std::vector<cv::Vec3f>& points, const TriangleTree& tree,
                             float limit, const std::stop_token& stop) {
  std::vector<float> result(points.size());
  cv::parallel_for_(cv::Range(0, static_cast<int>(points.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto index = static_cast<std::size_t>(i);
      result[index] = tree.distance(to_eigen(points[index]), limit);
    }
  });
  throw_if_stopped(stop);
  return result;
}

std::vector<cv::Vec3b> error_colors(const std::vector<float>& distances, float max_distance) {
  cv::Mat1b levels(1, static_cast<int>(distances.size()));
  for (std::size_t i = 0; i < distances.size(); ++i)
    levels(static_cast<int>(i)) =
        cv::saturate_cast<std::uint8_t>(255 * distances[i] / max_distance);
  cv::Mat3b colors;
  cv::applyColorMap(levels, colors, cv::COLORMAP_TURBO);
  return {colors.begin(), colors.end()};
}

}  // namespace

nlohmann::ordered_json to_json(const SurfaceScores& scores) {
  const auto rounded = [](double value) { return std::round(value * 1e6) / 1e6; };
  return {{"extent", rounded(scores.extent)},
          {"distance_median", rounded(scores.distance_median)},
          {"thresholds", to_json(scores.thresholds)}};
}

std::vector<cv::Vec3f> sample_surface(const SurfaceMesh& mesh, double spacing) {
  TARSIER_REQUIRE(spacing > 0 && std::isfinite(spacing), "a spacing of {}", spacing);
  // The additive recurrence of the plastic number, uniform in the unit square (Roberts, "The
  // unreasonable effectiveness of quasirandom sequences", 2018).
  constexpr double kFirst = 0.7548776662466927;
  constexpr double kSecond = 0.5698402909980532;
  std::vector<cv::Vec3f> points;
  double due = 0.5;  // points due for the area up to now
  for (const Face& face : mesh.faces) {
    const Eigen::Vector3f& a = mesh.vertices[static_cast<std::size_t>(face[0])];
    const Eigen::Vector3f ab = mesh.vertices[static_cast<std::size_t>(face[1])] - a;
    const Eigen::Vector3f ac = mesh.vertices[static_cast<std::size_t>(face[2])] - a;
    due += 0.5 * ab.cross(ac).norm() / (spacing * spacing);
    for (; due >= 1; due -= 1) {
      const auto n = static_cast<double>(points.size() + 1);
      double u = n * kFirst - std::floor(n * kFirst);
      double v = n * kSecond - std::floor(n * kSecond);
      if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
      }
      const Eigen::Vector3f at = a + static_cast<float>(u) * ab + static_cast<float>(v) * ac;
      points.emplace_back(at[0], at[1], at[2]);
    }
  }
  return points;
}

SurfaceScores evaluate_surface(const Workspace& cameras, const SurfaceMesh& truth,
                               const SurfaceMesh& surface, const geometry::Sim3& truth_from_model,
                               Progress& progress, const std::stop_token& stop) {
  for (const SurfaceMesh* mesh : {&truth, &surface}) {
    mesh->check();
    TARSIER_REQUIRE(area_of(*mesh) > 0, "the surface has no area");
  }
  SurfaceScores scores;
  scores.errors = surface;
  for (Eigen::Vector3f& vertex : scores.errors.vertices)
    vertex = (truth_from_model * Eigen::Vector3d(vertex.cast<double>())).cast<float>();

  std::vector<cv::Vec3f> truth_points = samples_of(truth);
  std::vector<int> seen(truth_points.size(), 0);
  progress.begin("truth", cameras.count(), "images");
  for (int i = 0; i < cameras.count(); ++i) {
    const GroundTruthView view = ground_truth_view(cameras, i);
    for (std::size_t k = 0; k < truth_points.size(); ++k) {
      if (k % 4096 == 0) throw_if_stopped(stop);
      if (seen[k] < 2 && view.sees(to_eigen(truth_points[k]).cast<double>())) ++seen[k];
    }
    progress.advance();
  }
  progress.end();
  std::size_t count = 0;
  for (std::size_t k = 0; k < truth_points.size(); ++k)
    if (seen[k] >= 2) truth_points[count++] = truth_points[k];
  truth_points.resize(count);
  if (truth_points.empty())
    throw InputError(cameras.folder(), "no part of the ground truth surface is seen by two images");

  scores.extent = extent_of(truth_points);
  const float limit = distance_limit(scores.extent);
  const TriangleTree true_tree(truth);
  std::vector<float> accuracy_distances =
      distances(samples_of(scores.errors), true_tree, limit, stop);
  const std::vector<float> completeness_distances =
      distances(truth_points, TriangleTree(scores.errors), limit, stop);
  scores.thresholds = score_thresholds(accuracy_distances, completeness_distances, scores.extent);
  scores.distance_median = lower_quantile(accuracy_distances, 0.5);
  std::vector<cv::Vec3f> vertices;
  vertices.reserve(scores.errors.vertices.size());
  for (const Eigen::Vector3f& vertex : scores.errors.vertices)
    vertices.emplace_back(vertex[0], vertex[1], vertex[2]);
  scores.errors.colors = error_colors(distances(vertices, true_tree, limit, stop), limit);
  return scores;
}

}  // namespace tarsier::sfm
