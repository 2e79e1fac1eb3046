// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/center_uncertainty.h"

#include "tarsier/core/at.h"
#include "tarsier/core/rng.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/mapper/mapper_options.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <numbers>
#include <vector>

namespace tarsier::sfm {
namespace {

// Cameras on an arc of a circle of radius 1, 6 degrees apart. They look outwards at a wall at
// radius 4. Each observes the points within 25 degrees. 60 cameras close the circle.
Model arc(int cameras, double noise_px, std::uint64_t seed, int points_per_step = 6) {
  Model model;
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 500;
  camera.cx = 320;
  camera.cy = 240;
  model.cameras = {camera};
  const double step = std::numbers::pi / 30;
  for (int i = 0; i < cameras; ++i) {
    const double angle = step * i;
    Image image;
    image.name = std::to_string(i);
    image.registered = true;
    const Eigen::Vector3d center(std::cos(angle), 0.2 * std::sin(3 * angle), std::sin(angle));
    const Eigen::Vector3d ahead(std::cos(angle), 0, std::sin(angle));
    const Eigen::Vector3d down(0, 1, 0);
    image.pose.rotation.row(0) = down.cross(ahead);
    image.pose.rotation.row(1) = down;
    image.pose.rotation.row(2) = ahead;
    image.pose.translation = -(image.pose.rotation * center);
    model.images.push_back(image);
  }
  Rng places(7);
  Rng noise(seed);
  for (int p = 0; p < points_per_step * cameras; ++p) {
    const double angle = step * places.uniform(0, cameras);
    Point point;
    const double radius = places.uniform(3.5, 4.5);
    point.position = {radius * std::cos(angle), places.uniform(-1, 1), radius * std::sin(angle)};
    for (int i = 0; i < cameras; ++i) {
      Image& image = model.images[at(i)];
      if (std::cos(angle - step * i) < std::cos(25 * std::numbers::pi / 180)) continue;
      const auto pixel = camera.project(image.pose * point.position);
      if (!pixel) continue;
      point.track.push_back({i, static_cast<int>(image.features.size())});
      image.features.emplace_back(
          *pixel + cv::Point2d(noise.normal(0, noise_px), noise.normal(0, noise_px)));
      image.points.push_back(p);
    }
    if (point.track.size() < 2) {
      for (const Observation& seen : point.track) {
        model.images[at(seen.image)].features.pop_back();
        model.images[at(seen.image)].points.pop_back();
      }
      continue;
    }
    model.points.push_back(point);
  }
  return model;
}

MapperOptions known_lens() {
  MapperOptions options;
  options.refine_focal = options.refine_center = options.refine_distortion = false;
  return options;
}

std::vector<Eigen::Vector3d> centers_of(const Model& model) {
  std::vector<Eigen::Vector3d> centers;
  for (const Image& image : model.images) centers.push_back(image.pose.center());
  return centers;
}

// Root mean square error of adjusted centres over `trials` of the noise, as a share of the extent.
double true_error(int cameras, double noise_px, int trials) {
  double squares = 0;
  for (int trial = 0; trial < trials; ++trial) {
    Model model = arc(cameras, noise_px, 100 + static_cast<std::uint64_t>(trial));
    const std::vector<Eigen::Vector3d> truth = centers_of(model);
    BundleOptions options;
    options.loss_px = 0;
    options.tolerance = 1e-10;
    EXPECT_EQ(adjust(model, options).warning, "");
    const std::vector<Eigen::Vector3d> found = centers_of(model);
    const auto similarity =
        geometry::similarity_between(geometry::columns_of(found), geometry::columns_of(truth));
    const auto columns = geometry::columns_of(truth);
    const double extent = (columns.rowwise().maxCoeff() - columns.rowwise().minCoeff()).norm();
    for (std::size_t i = 0; i < found.size(); ++i)
      squares += (*similarity * found[i] - truth[i]).squaredNorm() / (extent * extent) /
                 static_cast<double>(found.size() * at(trials));
  }
  return std::sqrt(squares);
}

TEST(CenterUncertainty, MatchesErrorCausedByNoise) {
  for (const int cameras : {8, 30}) {
    Model model = arc(cameras, 0.5, 1);
    (void)adjust(model, {});
    const auto uncertainty = center_uncertainty(model, known_lens());
    ASSERT_TRUE(uncertainty) << cameras;
    EXPECT_NEAR(uncertainty->sigma_px, 0.5, 0.1);
    const double error = true_error(cameras, 0.5, 12);
    EXPECT_GT(uncertainty->mean, 0.7 * error) << cameras;
    EXPECT_LT(uncertainty->mean, 1.4 * error) << cameras;
    EXPECT_GE(uncertainty->worst, uncertainty->mean);
  }
}

TEST(CenterUncertainty, IsProportionalToNoise) {
  const auto small = center_uncertainty(arc(20, 0.1, 1), known_lens());
  const auto large = center_uncertainty(arc(20, 1, 1), known_lens());
  ASSERT_TRUE(small && large);
  EXPECT_NEAR(large->mean / small->mean, 10, 2);
}

// The same spacing and points; only the closure of the circle differs.
TEST(CenterUncertainty, IsSmallerForClosedCircle) {
  const auto closed = center_uncertainty(arc(60, 0.5, 1), known_lens());
  Model open = arc(60, 0.5, 1);
  for (Point& point : open.points) {
    const bool shows_begin = point.track.front().image < 15;
    const bool shows_end = point.track.back().image >= 45;
    if (shows_begin && shows_end)
      std::erase_if(point.track, [](const Observation& seen) { return seen.image >= 45; });
    if (point.track.size() < 2) point = {};
  }
  const auto opened = center_uncertainty(open, known_lens());
  ASSERT_TRUE(closed && opened);
  EXPECT_GT(opened->worst, 2 * closed->worst);
  EXPECT_LT(uncertainty_trust_factor(*opened), uncertainty_trust_factor(*closed));
}

TEST(CenterUncertainty, IsLargerWithRefinedLens) {
  MapperOptions free_lens = known_lens();
  free_lens.refine_focal = free_lens.refine_distortion = true;
  const auto known = center_uncertainty(arc(20, 0.5, 1), known_lens());
  const auto refined = center_uncertainty(arc(20, 0.5, 1), free_lens);
  ASSERT_TRUE(known && refined);
  EXPECT_GT(refined->mean, 1.2 * known->mean);
}

TEST(CenterUncertainty, IsScaledFromUsedPointsToAll) {
  // 8 cameras observe nearly the same points, of which 600 are used.
  const auto few = center_uncertainty(arc(8, 0.5, 1, 150), known_lens());
  const auto many = center_uncertainty(arc(8, 0.5, 1, 600), known_lens());
  ASSERT_TRUE(few && many);
  EXPECT_NEAR(few->mean / many->mean, 2, 0.4);
}

TEST(CenterUncertainty, IsTheSameForAnyNumberOfThreads) {
  const Model model = arc(30, 0.5, 1, 60);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const auto one = center_uncertainty(model, known_lens());
  cv::setNumThreads(4);
  const auto four = center_uncertainty(model, known_lens());
  cv::setNumThreads(threads);
  ASSERT_TRUE(one && four);
  EXPECT_EQ(one->sigmas, four->sigmas);
}

TEST(CenterUncertainty, IsEmptyForTwoImagesOrNone) {
  EXPECT_FALSE(center_uncertainty(arc(2, 0.5, 1), known_lens()));
  EXPECT_FALSE(center_uncertainty({}, known_lens()));
}

TEST(CenterUncertainty, TrustFactorIsAtLeastHalf) {
  CenterUncertainty uncertainty;
  EXPECT_DOUBLE_EQ(uncertainty_trust_factor(uncertainty), 1);
  uncertainty.worst = 0.01;
  EXPECT_DOUBLE_EQ(uncertainty_trust_factor(uncertainty), 0.75);
  uncertainty.worst = 1;
  EXPECT_NEAR(uncertainty_trust_factor(uncertainty), 0.5, 1e-3);
}

}  // namespace
}  // namespace tarsier::sfm
