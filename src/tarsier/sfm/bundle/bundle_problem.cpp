// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/bundle_problem.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/sfm/bundle/point_selection.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr double kReferenceSizePx = 5;  // px
// px, residual of a scale twice as large; strong enough against thousands of points
constexpr double kScalePriorWeight = 1e4;

// Indices of the refined lens parameters.
std::vector<int> free_parameters(const BundleOptions& options) {
  std::vector<int> free;
  const auto add = [&](bool is_free, std::initializer_list<int> numbers) {
    if (is_free) std::copy(numbers.begin(), numbers.end(), std::back_inserter(free));
  };
  add(options.focal, {0});
  add(options.center, {2, 3});
  add(options.distortion, {4, 5, 6, 7});
  return free;
}

// Weight of a feature's residual: large features are located less accurately than small ones.
double weight_of(const Image& image, int feature) {
  if (image.sizes.empty()) return 1;
  const auto size = static_cast<double>(image.sizes[at(feature)]);
  return 1 / std::clamp(size / kReferenceSizePx, 0.7, 4.0);
}

}  // namespace

LensParameters lens_parameters_of(const geometry::Camera& camera) {
  return {camera.fx,
          camera.fy / camera.fx,
          camera.cx,
          camera.cy,
          camera.distortion[0],
          camera.distortion[1],
          camera.distortion[2],
          camera.distortion[3],
          camera.distortion[4]};
}

ModelProblem problem_of(const Model& model, const BundleOptions& options) {
  ModelProblem result;
  std::vector<int> moving_images = options.images;
  if (moving_images.empty()) {
    moving_images.resize(model.images.size());
    std::iota(moving_images.begin(), moving_images.end(), 0);
  }
  std::erase_if(moving_images,
                [&](int i) { return options.only_points || !model.images[at(i)].registered; });
  std::vector<char> is_moving(model.images.size(), 0);
  for (const int i : moving_images) is_moving[at(i)] = 1;
  for (const int i : options.fixed_images) is_moving[at(i)] = 0;
  std::erase_if(moving_images, [&](int i) { return is_moving[at(i)] == 0; });
  const auto moves = [&](const Observation& seen) { return is_moving[at(seen.image)] != 0; };
  const auto is_registered = [&](const Observation& seen) {
    return model.images[at(seen.image)].registered;
  };

  std::vector<int>& points = result.points;
  points = options.points;
  if (points.empty()) {
    for (std::size_t p = 0; p < model.points.size(); ++p) {
      const auto& track = model.points[p].track;
      const bool all = options.images.empty() && !options.fixed_images.empty() && !track.empty();
      if (all || std::any_of(track.begin(), track.end(), moves))
        points.push_back(static_cast<int>(p));
    }
  }
  if (points.empty()) return result;

  BundleProblem& problem = result.problem;
  problem.loss_px = options.loss_px;
  std::vector<int>& images = result.images;
  std::vector<int> pose_of(model.images.size(), -1);
  std::vector<int>& cameras = result.cameras;
  std::vector<int> lens_of(model.cameras.size(), -1);
  bool any_fixed = false;  // fixed images determine the frame
  const auto add_measurement = [&](const Observation& seen) {
    const Image& image = model.images[at(seen.image)];
    if (lens_of[at(image.camera)] < 0) {
      const geometry::Camera& camera = model.cameras[at(image.camera)];
      TARSIER_REQUIRE(camera.lens == geometry::Lens::kPinhole,
                      "a camera has a {} lens, but bundle adjustment needs a pinhole camera",
                      name_of(camera.lens));
      lens_of[at(image.camera)] = static_cast<int>(cameras.size());
      cameras.push_back(image.camera);
      problem.lenses.push_back(lens_parameters_of(camera));
    }
    const cv::Point2f& pixel = image.features[at(seen.feature)];
    problem.measurements.push_back({pose_of[at(seen.image)], lens_of[at(image.camera)],
                                    static_cast<double>(pixel.x), static_cast<double>(pixel.y),
                                    weight_of(image, seen.feature)});
  };
  const std::vector<ImageRole> roles = image_roles(model, moving_images, options.max_observations);
  std::vector<Observation> chosen;
  std::size_t observations = 0;
  const auto choose = [&](int p) {
    choose_observations(model.points[at(p)], p, roles, options.max_observations, chosen);
  };
  for (const int p : points) {
    choose(p);
    observations += chosen.size();
    for (const Observation& seen : chosen) {
      if (!is_registered(seen)) continue;
      pose_of[at(seen.image)] = 0;
      any_fixed = any_fixed || !moves(seen);
    }
  }
  // In the order of the model: neighbours often share points, and their blocks are then adjacent.
  for (std::size_t i = 0; i < pose_of.size(); ++i) {
    if (pose_of[i] < 0) continue;
    pose_of[i] = static_cast<int>(images.size());
    images.push_back(static_cast<int>(i));
    problem.poses.push_back(model.images[i].pose);
    problem.pose_moves.push_back(is_moving[i]);
  }
  problem.measurements.reserve(observations);
  for (const int p : points) {
    problem.points.push_back(model.points[at(p)].position);
    problem.first.push_back(problem.measurements.size());
    choose(p);
    for (const Observation& seen : chosen)
      if (is_registered(seen)) add_measurement(seen);
  }
  problem.point_moves.assign(points.size(), 1);
  problem.first.push_back(problem.measurements.size());
  if (options.images.empty() && !options.only_points)
    problem.free_parameters = free_parameters(options);
  problem.lens_moves.assign(cameras.size(), 1);
  for (const int camera : options.fixed_cameras)
    if (lens_of[at(camera)] >= 0) problem.lens_moves[at(lens_of[at(camera)])] = 0;

  if (!any_fixed) {
    // The first image is fixed. One coordinate of the farthest one fixes the scale. It is a
    // residual that can always become zero.
    const std::size_t first = 0;
    problem.pose_moves[first] = 0;
    const Eigen::Vector3d origin = problem.poses[first].center();
    std::size_t farthest = first;
    double longest = 0;
    for (std::size_t i = 0; i < images.size(); ++i) {
      const double distance = (problem.poses[i].center() - origin).norm();
      if (distance > longest) {
        longest = distance;
        farthest = i;
      }
    }
    if (farthest != first) {
      const Eigen::Vector3d center = problem.poses[farthest].center();
      const Eigen::Vector3d offset = center - origin;
      int axis = 0;
      offset.cwiseAbs().maxCoeff(&axis);
      problem.prior = {static_cast<int>(farthest), axis, center[axis],
                       kScalePriorWeight / std::max(1e-12, std::abs(offset[axis]))};
    }
  }
  return result;
}

}  // namespace tarsier::sfm
