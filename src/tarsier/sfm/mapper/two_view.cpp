// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/two_view.h"

#include "tarsier/core/statistics.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/sfm/mapper/triangulation.h"

#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

cv::UsacParams robust(double threshold, std::uint64_t seed) {
  cv::UsacParams params;
  params.confidence = 0.9999;
  params.isParallel = false;  // its threads would decide the result
  params.loIterations = 10;
  params.loMethod = cv::LOCAL_OPTIM_INNER_AND_ITER_LO;
  params.loSampleSize = 20;
  params.maxIterations = 5000;
  params.neighborsSearch = cv::NEIGH_GRID;
  params.randomGeneratorState = static_cast<int>(seed & 0x7fffffffU);
  params.sampler = cv::SAMPLING_UNIFORM;
  params.score = cv::SCORE_METHOD_MSAC;
  params.threshold = threshold;
  return params;
}

// Where no essential matrix fits: a camera that stayed at its place, or an image and its copy.
// Their matches are good, though they tell nothing of depth.
TwoView of_one_place(const std::vector<Match>& matches, const std::vector<cv::Point2d>& a,
                     const std::vector<cv::Point2d>& b, const TwoViewOptions& options) {
  TwoView result;
  cv::Mat mask;
  try {
    (void)cv::findHomography(a, b, mask, robust(options.threshold_px, options.seed));
  } catch (const cv::Exception&) {
    return result;
  }
  for (std::size_t i = 0; i < matches.size() && !mask.empty(); ++i)
    if (mask.at<std::uint8_t>(static_cast<int>(i)) != 0) result.inliers.push_back(matches[i]);
  if (result.inliers.size() < static_cast<std::size_t>(options.min_inliers)) result.inliers = {};
  result.homography_inliers = static_cast<int>(result.inliers.size());
  return result;
}

}  // namespace

std::vector<cv::Point2d> undistorted(const std::vector<cv::Point2f>& pixels,
                                     const geometry::Camera& camera) {
  std::vector<cv::Point2d> result;
  result.reserve(pixels.size());
  for (const cv::Point2f& pixel : pixels) {
    const cv::Point2d p(pixel);
    const auto ray = camera.is_distorted() ? camera.normalized_of(p) : std::nullopt;
    result.push_back(
        ray ? cv::Point2d(camera.fx * ray->x + camera.cx, camera.fy * ray->y + camera.cy) : p);
  }
  return result;
}

TwoView verify_pair(const std::vector<cv::Point2f>& first, const std::vector<cv::Point2f>& second,
                    const std::vector<Match>& matches, const geometry::Camera& camera,
                    const geometry::Camera& other, const TwoViewOptions& options) {
  options.check();
  TwoView result;
  const auto least = static_cast<std::size_t>(options.min_inliers);
  if (matches.size() < least) return result;
  std::vector<cv::Point2f> a;
  std::vector<cv::Point2f> b;
  for (const Match& match : matches) {
    a.push_back(first[static_cast<std::size_t>(match.first)]);
    b.push_back(second[static_cast<std::size_t>(match.second)]);
  }
  const std::vector<cv::Point2d> pixels_a = undistorted(a, camera);
  const std::vector<cv::Point2d> pixels_b = undistorted(b, other);
  const cv::UsacParams params = robust(options.threshold_px, options.seed);
  const cv::Matx33d k_a = camera.matrix();
  const cv::Matx33d k_b = other.matrix();

  cv::Mat mask;
  cv::Mat essential;
  try {
    if (!options.known_focal) {
      (void)cv::findFundamentalMat(pixels_a, pixels_b, mask, params);
    } else {
      essential = cv::findEssentialMat(pixels_a, pixels_b, k_a, k_b, cv::noArray(), cv::noArray(),
                                       mask, params);
    }
  } catch (const cv::Exception&) {
    mask.release();  // degenerate: no model was found
  }
  if (mask.empty()) return of_one_place(matches, pixels_a, pixels_b, options);
  std::vector<cv::Point2d> in_a;
  std::vector<cv::Point2d> in_b;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (mask.at<std::uint8_t>(static_cast<int>(i)) == 0) continue;
    result.inliers.push_back(matches[i]);
    in_a.push_back(pixels_a[i]);
    in_b.push_back(pixels_b[i]);
  }
  if (result.inliers.size() < least) return of_one_place(matches, pixels_a, pixels_b, options);

  // The pose, in normalised coordinates, from the inliers.
  const auto normalized = [](const std::vector<cv::Point2d>& pixels, const geometry::Camera& c) {
    std::vector<cv::Point2d> rays;
    for (const cv::Point2d& p : pixels) rays.emplace_back((p.x - c.cx) / c.fx, (p.y - c.cy) / c.fy);
    return rays;
  };
  const std::vector<cv::Point2d> rays_a = normalized(in_a, camera);
  const std::vector<cv::Point2d> rays_b = normalized(in_b, other);
  try {
    if (!options.known_focal) {
      cv::UsacParams wide = params;
      wide.threshold = 4 * options.threshold_px;
      essential = cv::findEssentialMat(in_a, in_b, k_a, k_b, cv::noArray(), cv::noArray(),
                                       cv::noArray(), wide);
    }
    cv::Mat homography_mask;
    cv::UsacParams plane = params;
    plane.threshold = 2 * options.threshold_px;
    (void)cv::findHomography(in_a, in_b, homography_mask, plane);
    result.homography_inliers = homography_mask.empty() ? 0 : cv::countNonZero(homography_mask);
    if (essential.rows == 3 && essential.cols == 3) {
      cv::Matx33d rotation;
      cv::Vec3d translation;
      (void)cv::recoverPose(essential, rays_a, rays_b, cv::Mat::eye(3, 3, CV_64F), rotation,
                            translation, 1e6);
      result.second_from_first = {geometry::to_eigen(rotation), geometry::to_eigen(translation)};
    }
  } catch (const cv::Exception&) {
    return result;
  }
  std::vector<double> angles;
  for (std::size_t i = 0; i < rays_a.size(); ++i) {
    const auto point = triangulate({{{}, rays_a[i]}, {result.second_from_first, rays_b[i]}});
    if (!point) continue;
    ++result.in_front;
    angles.push_back(ray_angle(*point, Eigen::Vector3d::Zero(), result.second_from_first.center()));
  }
  result.median_angle = upper_median(angles);
  return result;
}

}  // namespace tarsier::sfm
