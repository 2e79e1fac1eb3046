// SPDX-License-Identifier: MIT
#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/sfm/joining/join_models.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/scene/align.h"

#include <Eigen/Core>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>

namespace tarsier::sfm {
namespace {

using geometry::Sim3;

constexpr std::size_t kMaxSimilarityPoints = 4000;  // points for estimating a similarity
constexpr std::size_t kMaxRotations = 300;          // candidate images for the mean rotation
constexpr float kSameFeaturePx = 0.01F;             // px
constexpr double kSigmaPerMad = 1.4826;  // standard deviation / median absolute deviation

double median_of(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto median = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), median, values.end());
  return *median;
}

double depth_of(const Model& model, int image, const Eigen::Vector3d& position) {
  return (model.images[at(image)].pose * position).z();
}

// A point of each model, and the features that show both.
struct CommonPoint {
  int first = 0;
  int second = 0;
  std::vector<Observation> seen;
};

std::vector<CommonPoint> common_points(const Model& first, const Model& second,
                                       const std::vector<int>& images) {
  std::map<std::pair<int, int>, std::vector<Observation>> seen;
  for (const int image : images) {
    const std::vector<int>& in_first = first.images[at(image)].points;
    const std::vector<int>& in_second = second.images[at(image)].points;
    for (std::size_t f = 0; f < in_first.size(); ++f)
      if (in_first[f] >= 0 && in_second[f] >= 0)
        seen[{in_first[f], in_second[f]}].push_back({image, static_cast<int>(f)});
  }
  std::map<int, std::pair<std::size_t, int>> best_of_first;
  std::map<int, std::pair<std::size_t, int>> best_of_second;
  const auto prefer = [](std::map<int, std::pair<std::size_t, int>>& best, int point, int other,
                         std::size_t views) {
    auto [entry, fresh] = best.try_emplace(point, views, other);
    if (!fresh && views > entry->second.first) entry->second = {views, other};
  };
  for (const auto& [points, views] : seen) {
    prefer(best_of_first, points.first, points.second, views.size());
    prefer(best_of_second, points.second, points.first, views.size());
  }
  std::vector<CommonPoint> common;
  for (auto& [points, views] : seen) {
    if (best_of_first.at(points.first).second == points.second &&
        best_of_second.at(points.second).second == points.first)
      common.push_back({points.first, points.second, std::move(views)});
  }
  return common;
}

// Two models and their common images and points.
class JoinEstimator {
 public:
  JoinEstimator(const Model& first, const Model& second, const JoinOptions& options)
      : first_(first), second_(second), options_(options) {}

  ModelJoin run() {
    for (std::size_t i = 0; i < first_.images.size(); ++i)
      if (first_.images[i].registered && second_.images[i].registered)
        images_.push_back(static_cast<int>(i));
    join_.images = static_cast<int>(images_.size());
    join_.refusal = refusal();
    return std::move(join_);
  }

 private:
  std::string refusal() {
    if (join_.images < options_.min_images)
      return fmt::format("{} image{} in common, {} are needed", join_.images,
                         join_.images == 1 ? "" : "s", options_.min_images);
    for (const int image : images_) {
      const Image& a = first_.images[at(image)];
      const Image& b = second_.images[at(image)];
      if (!has_same_features(a, b))
        return fmt::format("'{}' has different features in the two models", a.name);
      if (!is_finite(a.pose) || !is_finite(b.pose))
        return fmt::format("the pose of '{}' is not finite", a.name);
    }
    points_ = common_points(first_, second_, images_);
    std::erase_if(points_, [&](const CommonPoint& point) {
      return !first_of(point).allFinite() || !second_of(point).allFinite();
    });
    join_.points = static_cast<int>(points_.size());
    if (join_.points < options_.min_points)
      return fmt::format("{} points in common, {} are needed", join_.points, options_.min_points);
    bool is_found = false;
    for (const std::optional<Sim3>& candidate :
         {similarity_from_points(), similarity_from_rotations()}) {
      if (!candidate || !is_similarity(*candidate)) continue;
      const std::pair<int, int> support{agreeing_images(*candidate), inliers_of(*candidate)};
      if (is_found && support <= std::pair(join_.agreeing, join_.inliers)) continue;
      is_found = true;
      join_.agreeing = support.first;
      join_.inliers = support.second;
      join_.first_from_second = *candidate;
    }
    if (!is_found) return "no similarity transformation aligns the points of the two models";
    measure();
    if (join_.inliers < options_.min_inlier_share * join_.points)
      return fmt::format("{} of {} points in common coincide after alignment, {:.0f} % are needed",
                         join_.inliers, join_.points, 100 * options_.min_inlier_share);
    if (join_.agreeing <
        std::max<double>(options_.min_images, options_.min_image_share * join_.images - 1e-9))
      return fmt::format(
          "{} of {} images in common have the same pose in both models (median difference {:.1f} "
          "degrees); {:.0f} %, and {} or more images, are needed",
          join_.agreeing, join_.images, join_.rotation_deg, 100 * options_.min_image_share,
          options_.min_images);
    if (!(join_.scale_error <= options_.max_scale_error))
      return fmt::format("the standard error of the scale is {:.1f} %, at most {:.1f} % is allowed",
                         100 * join_.scale_error, 100 * options_.max_scale_error);
    return {};
  }

  static bool is_finite(const geometry::Rigid3& pose) {
    return pose.rotation.allFinite() && pose.translation.allFinite();
  }
  static bool is_similarity(const Sim3& s) {
    return s.scale > 0 && std::isfinite(s.scale) && s.rotation.allFinite() &&
           s.translation.allFinite();
  }
  [[nodiscard]] const Eigen::Vector3d& first_of(const CommonPoint& point) const {
    return first_.points[at(point.first)].position;
  }
  [[nodiscard]] const Eigen::Vector3d& second_of(const CommonPoint& point) const {
    return second_.points[at(point.second)].position;
  }

  [[nodiscard]] std::optional<Sim3> similarity_from_points() const {
    std::vector<Eigen::Vector3d> from;
    std::vector<Eigen::Vector3d> to;
    const std::size_t samples = std::min(points_.size(), kMaxSimilarityPoints);
    for (std::size_t k = 0; k < samples; ++k) {
      const CommonPoint& point = points_[k * points_.size() / samples];
      to.push_back(first_of(point));
      from.push_back(second_of(point));
    }
    for (const int image : images_) {
      to.push_back(first_.images[at(image)].pose.center());
      from.push_back(second_.images[at(image)].pose.center());
    }
    return robust_similarity(from, to, 0, options_.seed);
  }

  [[nodiscard]] std::optional<Sim3> similarity_from_rotations() const {
    std::vector<Eigen::Matrix3d> rotations;
    const std::size_t samples = std::min(images_.size(), kMaxRotations);
    for (std::size_t k = 0; k < samples; ++k) {
      const std::size_t image = at(images_[k * images_.size() / samples]);
      rotations.emplace_back(first_.images[image].pose.rotation.transpose() *
                             second_.images[image].pose.rotation);
    }
    const Eigen::Matrix3d* median_rotation = nullptr;
    double best = 0;
    for (const Eigen::Matrix3d& rotation : rotations) {
      std::vector<double> angles;
      angles.reserve(rotations.size());
      for (const Eigen::Matrix3d& other : rotations)
        angles.push_back(geometry::angle_of(rotation.transpose() * other));
      const double median = median_of(std::move(angles));
      if (median_rotation == nullptr || median < best) {
        median_rotation = &rotation;
        best = median;
      }
    }
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const Eigen::Matrix3d& other : rotations)
      if (geometry::angle_of(median_rotation->transpose() * other) * kDegreesPerRadian <=
          options_.max_rotation_deg)
        sum += other;
    Sim3 result;
    result.rotation = geometry::nearest_rotation(sum);
    const std::vector<double> ratios = log_depth_ratios([](const CommonPoint&) { return true; });
    if (ratios.empty()) return std::nullopt;
    result.scale = std::exp(median_of(ratios));
    for (int k = 0; k < 3; ++k) {
      std::vector<double> offsets;
      offsets.reserve(points_.size());
      for (const CommonPoint& point : points_)
        offsets.push_back(
            (first_of(point) - result.scale * (result.rotation * second_of(point)))[k]);
      result.translation[k] = median_of(std::move(offsets));
    }
    return result;
  }

  // log(depth in the first / depth in the second) of each point: the median over its features,
  // where both depths are positive.
  template <class Predicate>
  [[nodiscard]] std::vector<double> log_depth_ratios(const Predicate& is_included) const {
    std::vector<double> ratios;
    for (const CommonPoint& point : points_) {
      if (!is_included(point)) continue;
      std::vector<double> of_point;
      for (const Observation& seen : point.seen) {
        const double a = depth_of(first_, seen.image, first_of(point));
        const double b = depth_of(second_, seen.image, second_of(point));
        if (a > 0 && b > 0) of_point.push_back(std::log(a / b));
      }
      if (!of_point.empty()) ratios.push_back(median_of(std::move(of_point)));
    }
    return ratios;
  }

  [[nodiscard]] bool is_within_limit(const Model& model, const Observation& seen,
                                     const Eigen::Vector3d& position) const {
    const geometry::Camera& camera = model.cameras[at(model.images[at(seen.image)].camera)];
    const double limit =
        std::max(options_.inlier_px, options_.inlier_share * std::max(camera.width, camera.height));
    const auto error = IncrementalMapper::reprojection_error(model, seen, position);
    return error && *error <= limit;
  }

  [[nodiscard]] bool is_inlier(const CommonPoint& point, const Sim3& similarity,
                               const Sim3& inverse) const {
    const Eigen::Vector3d in_first = similarity * second_of(point);
    const Eigen::Vector3d in_second = inverse * first_of(point);
    return std::all_of(point.seen.begin(), point.seen.end(), [&](const Observation& seen) {
      return is_within_limit(first_, seen, in_first) && is_within_limit(second_, seen, in_second);
    });
  }

  [[nodiscard]] int inliers_of(const Sim3& similarity) const {
    const Sim3 inverse = similarity.inverse();
    return static_cast<int>(std::count_if(
        points_.begin(), points_.end(),
        [&](const CommonPoint& point) { return is_inlier(point, similarity, inverse); }));
  }

  // Angle between an image's pose in the first model and its transformed pose in the second.
  [[nodiscard]] double angle_between(int image, const Sim3& similarity) const {
    const geometry::Rigid3 moved =
        geometry::moved_camera(second_.images[at(image)].pose, similarity);
    return geometry::angle_of(first_.images[at(image)].pose.rotation.transpose() * moved.rotation) *
           kDegreesPerRadian;
  }

  [[nodiscard]] int agreeing_images(const Sim3& similarity) const {
    std::map<int, std::vector<double>> depths;
    for (const CommonPoint& point : points_)
      for (const Observation& seen : point.seen)
        depths[seen.image].push_back(depth_of(first_, seen.image, first_of(point)));
    int count = 0;
    for (auto& [image, all] : depths) {
      const double center_distance = (first_.images[at(image)].pose.center() -
                                      similarity * second_.images[at(image)].pose.center())
                                         .norm();
      if (angle_between(image, similarity) <= options_.max_rotation_deg &&
          center_distance <= options_.max_center_share * median_of(std::move(all)))
        ++count;
    }
    return count;
  }

  void measure() {
    const Sim3& similarity = join_.first_from_second;
    std::vector<double> angles;
    angles.reserve(images_.size());
    for (const int image : images_) angles.push_back(angle_between(image, similarity));
    join_.rotation_deg = median_of(std::move(angles));
    const Sim3 inverse = similarity.inverse();
    std::vector<double> ratios = log_depth_ratios(
        [&](const CommonPoint& point) { return is_inlier(point, similarity, inverse); });
    const double median = median_of(ratios);
    for (double& ratio : ratios) ratio = std::abs(ratio - median);
    const auto count = static_cast<double>(std::max<std::size_t>(1, ratios.size()));
    join_.scale_error = kSigmaPerMad * median_of(std::move(ratios)) / std::sqrt(count);
  }

  const Model& first_;
  const Model& second_;
  const JoinOptions& options_;
  std::vector<int> images_;
  std::vector<CommonPoint> points_;
  ModelJoin join_;
};

}  // namespace

bool has_same_features(const Image& a, const Image& b) {
  return a.features.size() == b.features.size() &&
         std::equal(a.features.begin(), a.features.end(), b.features.begin(),
                    [](const cv::Point2f& p, const cv::Point2f& q) {
                      return std::abs(p.x - q.x) <= kSameFeaturePx &&
                             std::abs(p.y - q.y) <= kSameFeaturePx;
                    });
}

ModelJoin find_join(const Model& first, const Model& second, const JoinOptions& options) {
  options.check();
  return JoinEstimator(first, second, options).run();
}

}  // namespace tarsier::sfm
