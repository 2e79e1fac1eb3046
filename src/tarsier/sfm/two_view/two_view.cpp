// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/two_view.h"

#include "tarsier/core/statistics.h"
#include "tarsier/sfm/two_view/robust_two_view.h"
#include "tarsier/sfm/two_view/triangulation.h"

#include <algorithm>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr int kMaxHomographySamples = 500;

Eigen::Vector2d normalized(const cv::Point2d& pixel, const geometry::Camera& camera) {
  return {(pixel.x - camera.cx) / camera.fx, (pixel.y - camera.cy) / camera.fy};
}

// Indices sorted by ascending ratio.
std::vector<int> order_of(const std::vector<float>& ratios) {
  std::vector<int> order(ratios.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return ratios[static_cast<std::size_t>(a)] < ratios[static_cast<std::size_t>(b)];
  });
  return order;
}

double mean_focal(const geometry::Camera& first, const geometry::Camera& second) {
  return (first.fx + first.fy + second.fx + second.fy) / 4;
}

// Undistorted pixels.
PointPairs pixels_of(const std::vector<cv::Point2f>& first, const std::vector<cv::Point2f>& second,
                     const geometry::Camera& camera, const geometry::Camera& other) {
  PointPairs pixels;
  for (const cv::Point2d& p : undistorted(first, camera)) pixels.first.emplace_back(p.x, p.y);
  for (const cv::Point2d& p : undistorted(second, other)) pixels.second.emplace_back(p.x, p.y);
  return pixels;
}

PointPairs rays_of(const PointPairs& pixels, const geometry::Camera& camera,
                   const geometry::Camera& other) {
  PointPairs rays;
  for (std::size_t i = 0; i < pixels.first.size(); ++i) {
    rays.first.push_back(normalized({pixels.first[i][0], pixels.first[i][1]}, camera));
    rays.second.push_back(normalized({pixels.second[i][0], pixels.second[i][1]}, other));
  }
  return rays;
}

// Sets the motion, the number of inliers in front of both cameras, and their median angle.
void set_motion(const PointPairs& inliers, const geometry::Rigid3& motion, TwoView& view) {
  view.second_from_first = motion;
  view.in_front = 0;
  std::vector<double> angles;
  for (std::size_t i = 0; i < inliers.first.size(); ++i) {
    const auto point = triangulate({{{}, {inliers.first[i][0], inliers.first[i][1]}},
                                    {motion, {inliers.second[i][0], inliers.second[i][1]}}});
    if (!point) continue;
    ++view.in_front;
    angles.push_back(ray_angle(*point, Eigen::Vector3d::Zero(), motion.center()));
  }
  view.median_angle = upper_median(angles);
}

// The inlier pairs.
PointPairs inlier_pairs(const PointPairs& pairs, const std::vector<char>& is_inlier) {
  PointPairs result;
  for (std::size_t i = 0; i < is_inlier.size(); ++i) {
    if (is_inlier[i] == 0) continue;
    result.first.push_back(pairs.first[i]);
    result.second.push_back(pairs.second[i]);
  }
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
                    const geometry::Camera& other, const TwoViewOptions& options,
                    const std::vector<float>& ratios) {
  options.check();
  TwoView result;
  const auto min_inliers = static_cast<std::size_t>(options.min_inliers);
  if (matches.size() < min_inliers) return result;
  std::vector<cv::Point2f> a;
  std::vector<cv::Point2f> b;
  for (const Match& match : matches) {
    a.push_back(first[static_cast<std::size_t>(match.first)]);
    b.push_back(second[static_cast<std::size_t>(match.second)]);
  }
  PointPairs pixels = pixels_of(a, b, camera, other);
  PointPairs rays = rays_of(pixels, camera, other);
  pixels.order = rays.order = order_of(ratios);
  RobustOptions in_pixels;
  in_pixels.threshold = options.threshold_px;
  in_pixels.seed = options.seed;
  RobustOptions in_rays = in_pixels;
  in_rays.threshold /= mean_focal(camera, other);
  std::vector<char> is_inlier;
  RobustMotion motion;
  if (options.known_focal) {
    motion = robust_motion(rays, in_rays);
    is_inlier = motion.is_inlier;
  } else {
    is_inlier = robust_fundamental(pixels, in_pixels).is_inlier;
  }
  if (std::count(is_inlier.begin(), is_inlier.end(), 1) < options.min_inliers) return result;
  std::vector<Match> inlier_matches;
  for (std::size_t i = 0; i < matches.size(); ++i)
    if (is_inlier[i] != 0) inlier_matches.push_back(matches[i]);
  result.inliers = std::move(inlier_matches);
  const PointPairs inliers = inlier_pairs(rays, is_inlier);
  if (!options.known_focal) {
    in_rays.threshold *= 4;  // the focal length may be inexact
    motion = robust_motion(inliers, in_rays);
  }
  in_pixels.threshold *= 2;
  in_pixels.max_samples = kMaxHomographySamples;
  result.homography_inliers = robust_homography(inlier_pairs(pixels, is_inlier), in_pixels).inliers;
  set_motion(inliers, motion.second_from_first, result);
  return result;
}

void estimate_motion_again(const std::vector<cv::Point2f>& first,
                           const std::vector<cv::Point2f>& second, const geometry::Camera& camera,
                           const geometry::Camera& other, const TwoViewOptions& options,
                           TwoView& view) {
  if (view.inliers.empty()) return;
  std::vector<cv::Point2f> a;
  std::vector<cv::Point2f> b;
  for (const Match& match : view.inliers) {
    a.push_back(first[static_cast<std::size_t>(match.first)]);
    b.push_back(second[static_cast<std::size_t>(match.second)]);
  }
  const PointPairs rays = rays_of(pixels_of(a, b, camera, other), camera, other);
  RobustOptions in_rays;
  in_rays.threshold = 2 * options.threshold_px / mean_focal(camera, other);
  in_rays.seed = options.seed;
  const RobustMotion motion = robust_motion(rays, in_rays);
  if (motion.inliers > 0) set_motion(rays, motion.second_from_first, view);
}

}  // namespace tarsier::sfm
