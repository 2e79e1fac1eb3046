// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_join.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/sfm/global/rotation_averaging.h"
#include "tarsier/sfm/mapper/bundle.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/model_parts.h"
#include "tarsier/sfm/scene/align.h"

#include <Eigen/Core>
#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

namespace tarsier::sfm {
namespace {

using geometry::Sim3;

constexpr double kDegrees = 180 / CV_PI;
constexpr std::size_t kMaxSamples = 4000;   // points that a similarity is estimated from
constexpr std::size_t kMaxRotations = 300;  // images that the mean rotation is looked for among
constexpr float kSameFeature = 0.01F;       // px
constexpr double kNormal = 1.4826;          // standard deviations in a median absolute deviation
// Of a join that closes a cycle, after what drift may do.
constexpr double kMaxOpenDeg = 10;
constexpr double kMaxOpenScale = 0.25;
constexpr double kMaxOpenShare = 0.1;  // of the extent
// Of the adjustments of a joined model, from rough to fine: where a cycle is open, errors are large at first.
constexpr double kLosses[] = {8, 2, 0.5};  // px
constexpr std::int64_t kManyObservations = 1'000'000;
constexpr int kMaxObservations = 40;  // of a point, where there are many

std::size_t at(int i) { return static_cast<std::size_t>(i); }

double median_of(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

bool has_same_features(const Image& a, const Image& b) {
  return a.features.size() == b.features.size() &&
         std::equal(a.features.begin(), a.features.end(), b.features.begin(),
                    [](const cv::Point2f& p, const cv::Point2f& q) {
                      return std::abs(p.x - q.x) <= kSameFeature &&
                             std::abs(p.y - q.y) <= kSameFeature;
                    });
}

double depth_of(const Model& model, int image, const Eigen::Vector3d& position) {
  return (model.images[at(image)].pose * position).z();
}

// A point of the first model and one of the second, and the features that show both.
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

// Two models and what they have in common.
class Joining {
 public:
  Joining(const Model& first, const Model& second, const JoinOptions& options)
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
        return fmt::format("the features of '{}' are not the same in both", a.name);
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
    for (const std::optional<Sim3>& candidate : {by_points(), by_rotations()}) {
      if (!candidate || !is_similarity(*candidate)) continue;
      const std::pair<int, int> support{agreeing_images(*candidate), inliers_of(*candidate)};
      if (is_found && support <= std::pair(join_.agreeing, join_.inliers)) continue;
      is_found = true;
      join_.agreeing = support.first;
      join_.inliers = support.second;
      join_.first_from_second = *candidate;
    }
    if (!is_found) return "no similarity takes the points of one to those of the other";
    measure();
    if (join_.inliers < options_.min_inlier_share * join_.points)
      return fmt::format("{} of {} points in common lie at the same place, {:.0f} % are needed",
                         join_.inliers, join_.points, 100 * options_.min_inlier_share);
    if (join_.agreeing <
        std::max<double>(options_.min_images, options_.min_image_share * join_.images - 1e-9))
      return fmt::format(
          "{} of {} images in common have the same pose in both ({:.1f} degrees between them at "
          "the "
          "median), {:.0f} % and {} are needed",
          join_.agreeing, join_.images, join_.rotation_deg, 100 * options_.min_image_share,
          options_.min_images);
    if (!(join_.scale_error <= options_.max_scale_error))
      return fmt::format("the scale is known to {:.1f} %, {:.1f} % are needed",
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

  [[nodiscard]] std::optional<Sim3> by_points() const {
    std::vector<Eigen::Vector3d> from;
    std::vector<Eigen::Vector3d> to;
    const std::size_t samples = std::min(points_.size(), kMaxSamples);
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

  [[nodiscard]] std::optional<Sim3> by_rotations() const {
    std::vector<Eigen::Matrix3d> rotations;
    const std::size_t samples = std::min(images_.size(), kMaxRotations);
    for (std::size_t k = 0; k < samples; ++k) {
      const std::size_t image = at(images_[k * images_.size() / samples]);
      rotations.push_back(first_.images[image].pose.rotation.transpose() *
                          second_.images[image].pose.rotation);
    }
    const Eigen::Matrix3d* middle = nullptr;
    double best = 0;
    for (const Eigen::Matrix3d& rotation : rotations) {
      std::vector<double> angles;
      for (const Eigen::Matrix3d& other : rotations)
        angles.push_back(geometry::angle_of(rotation.transpose() * other));
      const double median = median_of(std::move(angles));
      if (middle == nullptr || median < best) {
        middle = &rotation;
        best = median;
      }
    }
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const Eigen::Matrix3d& other : rotations)
      if (geometry::angle_of(middle->transpose() * other) * kDegrees <= options_.max_rotation_deg)
        sum += other;
    Sim3 result;
    result.rotation = geometry::nearest_rotation(sum);
    const std::vector<double> ratios = log_depth_ratios([](const CommonPoint&) { return true; });
    if (ratios.empty()) return std::nullopt;
    result.scale = std::exp(median_of(ratios));
    for (int k = 0; k < 3; ++k) {
      std::vector<double> offsets;
      for (const CommonPoint& point : points_)
        offsets.push_back(
            (first_of(point) - result.scale * (result.rotation * second_of(point)))[k]);
      result.translation[k] = median_of(std::move(offsets));
    }
    return result;
  }

  // log(depth in the first / depth in the second) of each point, at the median of its features, where both are in front.
  template <class Wanted>
  [[nodiscard]] std::vector<double> log_depth_ratios(const Wanted& wanted) const {
    std::vector<double> ratios;
    for (const CommonPoint& point : points_) {
      if (!wanted(point)) continue;
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

  [[nodiscard]] bool is_near(const Model& model, const Observation& seen,
                             const Eigen::Vector3d& position) const {
    const geometry::Camera& camera = model.cameras[at(model.images[at(seen.image)].camera)];
    const double limit =
        std::max(options_.inlier_px, options_.inlier_share * std::max(camera.width, camera.height));
    const auto error = IncrementalMapper::error_of(model, seen, position);
    return error && *error <= limit;
  }

  [[nodiscard]] bool is_inlier(const CommonPoint& point, const Sim3& similarity,
                               const Sim3& inverse) const {
    const Eigen::Vector3d in_first = similarity * second_of(point);
    const Eigen::Vector3d in_second = inverse * first_of(point);
    return std::all_of(point.seen.begin(), point.seen.end(), [&](const Observation& seen) {
      return is_near(first_, seen, in_first) && is_near(second_, seen, in_second);
    });
  }

  [[nodiscard]] int inliers_of(const Sim3& similarity) const {
    const Sim3 inverse = similarity.inverse();
    return static_cast<int>(std::count_if(
        points_.begin(), points_.end(),
        [&](const CommonPoint& point) { return is_inlier(point, similarity, inverse); }));
  }

  // Between the pose in the first model and that in the second after it was moved.
  [[nodiscard]] double angle_between(int image, const Sim3& similarity) const {
    const geometry::Rigid3 moved =
        geometry::moved_camera(second_.images[at(image)].pose, similarity);
    return geometry::angle_of(first_.images[at(image)].pose.rotation.transpose() * moved.rotation) *
           kDegrees;
  }

  [[nodiscard]] int agreeing_images(const Sim3& similarity) const {
    std::map<int, std::vector<double>> depths;
    for (const CommonPoint& point : points_)
      for (const Observation& seen : point.seen)
        depths[seen.image].push_back(depth_of(first_, seen.image, first_of(point)));
    int count = 0;
    for (auto& [image, all] : depths) {
      const double off = (first_.images[at(image)].pose.center() -
                          similarity * second_.images[at(image)].pose.center())
                             .norm();
      if (angle_between(image, similarity) <= options_.max_rotation_deg &&
          off <= options_.max_center_share * median_of(std::move(all)))
        ++count;
    }
    return count;
  }

  void measure() {
    const Sim3& similarity = join_.first_from_second;
    std::vector<double> angles;
    for (const int image : images_) angles.push_back(angle_between(image, similarity));
    join_.rotation_deg = median_of(std::move(angles));
    const Sim3 inverse = similarity.inverse();
    std::vector<double> ratios = log_depth_ratios(
        [&](const CommonPoint& point) { return is_inlier(point, similarity, inverse); });
    const double middle = median_of(ratios);
    for (double& ratio : ratios) ratio = std::abs(ratio - middle);
    const auto count = static_cast<double>(std::max<std::size_t>(1, ratios.size()));
    join_.scale_error = kNormal * median_of(std::move(ratios)) / std::sqrt(count);
  }

  const Model& first_;
  const Model& second_;
  const JoinOptions& options_;
  std::vector<int> images_;
  std::vector<CommonPoint> points_;
  ModelJoin join_;
};

// The diagonal of the box around centres.
double extent_of(const std::vector<Eigen::Vector3d>& centers) {
  if (centers.empty()) return 0;
  Eigen::Vector3d low = centers.front();
  Eigen::Vector3d high = centers.front();
  for (const Eigen::Vector3d& center : centers) {
    low = low.cwiseMin(center);
    high = high.cwiseMax(center);
  }
  return (high - low).norm();
}

double extent_of(const Model& model) {
  std::vector<Eigen::Vector3d> centers;
  for (const Image& image : model.images)
    if (image.registered) centers.push_back(image.pose.center());
  return extent_of(centers);
}

int registered_of(const Model& model) {
  return static_cast<int>(std::count_if(model.images.begin(), model.images.end(),
                                        [](const Image& image) { return image.registered; }));
}

// Which models become one, and where each lies in it.
class Groups {
 public:
  Groups(const std::vector<Model>& models, std::vector<ModelJoin>& joins)
      : models_(models), joins_(joins), group_(models.size()), place_(models.size()) {
    std::iota(group_.begin(), group_.end(), 0);
  }

  void run(const std::stop_token& stop) {
    std::vector<std::size_t> order(joins_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return joins_[a].inliers > joins_[b].inliers;
    });
    std::vector<char> closes(models_.size(), 0);  // of each group, at its first model
    for (const std::size_t k : order) {
      ModelJoin& join = joins_[k];
      if (!join.refusal.empty()) continue;
      const int a = group_[at(join.first)];
      const int b = group_[at(join.second)];
      if (a != b) {
        unite(join, a, b);
        if (closes[at(std::max(a, b))] != 0) closes[at(std::min(a, b))] = 1;
      } else if (join.refusal = why_open(join); join.refusal.empty()) {
        closes[at(a)] = 1;
      }
    }
    for (std::size_t g = 0; g < models_.size(); ++g)
      if (closes[g] != 0 && group_[g] == static_cast<int>(g)) average(static_cast<int>(g), stop);
  }

  // Models of each group, the one with most images first; its frame is that of the group.
  [[nodiscard]] std::vector<std::vector<int>> members() const {
    std::map<int, std::vector<int>> by_group;
    for (std::size_t m = 0; m < group_.size(); ++m)
      by_group[group_[m]].push_back(static_cast<int>(m));
    std::vector<std::vector<int>> result;
    for (auto& [group, all] : by_group) {
      std::stable_sort(all.begin(), all.end(), [&](int a, int b) {
        return registered_of(models_[at(a)]) > registered_of(models_[at(b)]);
      });
      result.push_back(std::move(all));
    }
    return result;
  }

  // Into the frame of `root`, of the same group.
  [[nodiscard]] Sim3 place(int model, int root) const {
    return place_[at(root)].inverse() * place_[at(model)];
  }

 private:
  void unite(const ModelJoin& join, int a, int b) {
    // world_from_second is to be world_from_first * first_from_second.
    const Sim3 move =
        place_[at(join.first)] * join.first_from_second * place_[at(join.second)].inverse();
    const int kept = std::min(a, b);
    for (std::size_t m = 0; m < group_.size(); ++m) {
      if (group_[m] == b) place_[m] = move * place_[m];
      if (group_[m] == a || group_[m] == b) group_[m] = kept;
    }
  }

  // Between what a join says and where the two models lie by other joins.
  [[nodiscard]] std::string why_open(const ModelJoin& join) const {
    const Sim3 known = place_[at(join.first)].inverse() * place_[at(join.second)];
    const Sim3& says = join.first_from_second;
    const double angle = geometry::angle_of(known.rotation.transpose() * says.rotation) * kDegrees;
    const double scale = std::abs(std::log(known.scale / says.scale));
    double off = 0;
    double count = 0;
    std::vector<Eigen::Vector3d> centers;
    for (std::size_t m = 0; m < models_.size(); ++m) {
      if (group_[m] != group_[at(join.first)]) continue;
      const Sim3 to_first = place_[at(join.first)].inverse() * place_[m];
      for (const Image& image : models_[m].images)
        if (image.registered) centers.push_back(to_first * image.pose.center());
    }
    for (std::size_t i = 0; i < models_.front().images.size(); ++i) {
      const Image& a = models_[at(join.first)].images[i];
      const Image& b = models_[at(join.second)].images[i];
      if (!a.registered || !b.registered) continue;
      off += (known * b.pose.center() - says * b.pose.center()).norm();
      count += 1;
    }
    const double share = off / count / std::max(1e-300, extent_of(centers));
    if (angle <= kMaxOpenDeg && scale <= kMaxOpenScale && share <= kMaxOpenShare) return {};
    return fmt::format(
        "it contradicts joins of more points: {:.1f} degrees, a scale of {:.2f}, {:.1f} % of the "
        "extent",
        angle, std::exp(scale), 100 * share);
  }

  // Spreads what cycles leave open.
  void average(int group, const std::stop_token& stop) {
    std::vector<int> members;
    std::vector<int> index(models_.size(), -1);
    for (std::size_t m = 0; m < group_.size(); ++m) {
      if (group_[m] != group) continue;
      index[m] = static_cast<int>(members.size());
      members.push_back(static_cast<int>(m));
    }
    std::vector<const ModelJoin*> joins;
    std::vector<RelativeRotation> rotations;
    for (const ModelJoin& join : joins_) {
      if (!join.refusal.empty() || index[at(join.first)] < 0) continue;
      joins.push_back(&join);
      rotations.push_back({index[at(join.first)], index[at(join.second)],
                           join.first_from_second.rotation.transpose(),
                           static_cast<double>(join.inliers)});
    }
    const auto count = static_cast<int>(members.size());
    const AveragedRotations averaged = average_rotations(count, rotations, {}, stop);
    // In the frame of the first member.
    const Sim3 anchor = place_[at(members.front())];
    std::vector<Sim3> places(members.size());
    for (std::size_t m = 0; m < members.size(); ++m)
      places[m].rotation = averaged.rotations[m].transpose();
    // Unknowns of all but the first, which stays at 0.
    Eigen::MatrixXd laplacian = Eigen::MatrixXd::Zero(count, count);
    const auto solve = [&](const auto& difference, int columns) {
      laplacian.setZero();
      Eigen::MatrixXd right = Eigen::MatrixXd::Zero(count, columns);
      for (const ModelJoin* join : joins) {
        const int a = index[at(join->first)];
        const int b = index[at(join->second)];
        const double weight = join->inliers;
        const Eigen::RowVectorXd step = weight * difference(*join, a);
        laplacian(a, a) += weight;
        laplacian(b, b) += weight;
        laplacian(a, b) -= weight;
        laplacian(b, a) -= weight;
        right.row(a) -= step;
        right.row(b) += step;
      }
      Eigen::MatrixXd result = Eigen::MatrixXd::Zero(count, columns);
      result.bottomRows(count - 1) = linalg::solve_symmetric(
          laplacian.bottomRightCorner(count - 1, count - 1), right.bottomRows(count - 1));
      return result;
    };
    const Eigen::MatrixXd scales = solve(
        [](const ModelJoin& join, int) -> Eigen::RowVectorXd {
          return Eigen::RowVectorXd::Constant(1, std::log(join.first_from_second.scale));
        },
        1);
    for (std::size_t m = 0; m < members.size(); ++m)
      places[m].scale = std::exp(scales(static_cast<Eigen::Index>(m), 0));
    const Eigen::MatrixXd offsets = solve(
        [&](const ModelJoin& join, int a) -> Eigen::RowVectorXd {
          return (places[at(a)].scale *
                  (places[at(a)].rotation * join.first_from_second.translation))
              .transpose();
        },
        3);
    for (std::size_t m = 0; m < members.size(); ++m) {
      places[m].translation = offsets.row(static_cast<Eigen::Index>(m)).transpose();
      place_[at(members[m])] = anchor * places[m];
    }
  }

  const std::vector<Model>& models_;
  std::vector<ModelJoin>& joins_;
  std::vector<int> group_;
  std::vector<Sim3> place_;  // world_from_model, of the group's world
};

// The tracks of several models as one list of points.
class UnitedPoints {
 public:
  explicit UnitedPoints(const std::vector<Image>& images) {
    for (const Image& image : images) owner_.emplace_back(image.features.size(), -1);
  }

  // `moved`: the position in the common frame; `track`: what counts of its observations.
  void add(const Point& point, const Eigen::Vector3d& moved, std::vector<Observation> track) {
    std::map<int, int> views;  // of the points that have some of the track already
    for (const Observation& seen : track)
      if (const int owner = owner_of(seen); owner >= 0) ++views[owner];
    std::vector<std::pair<int, int>> order;
    for (const auto& [owner, count] : views) order.emplace_back(-count, owner);
    std::sort(order.begin(), order.end());
    const auto weight = static_cast<double>(track.size());
    std::erase_if(track, [&](const Observation& seen) { return owner_of(seen) >= 0; });
    sort_by_image(track);
    int base = -1;
    for (const auto& [count, owner] : order) {
      if (shows_another(points_[at(owner)].track, track)) continue;
      if (base < 0) {
        base = owner;
      } else if (!shows_another(points_[at(owner)].track, points_[at(base)].track)) {
        United& from = points_[at(owner)];
        take(base, from.track);
        points_[at(base)].sum += from.sum;
        points_[at(base)].color += from.color;
        points_[at(base)].weight += from.weight;
        from = {};
      }
    }
    if (base < 0) {
      if (track.size() < 2) return;
      base = static_cast<int>(points_.size());
      points_.emplace_back();
    }
    take(base, track);
    United& united = points_[at(base)];
    united.sum += weight * moved;
    united.color += cv::Vec3d(point.color) * weight;
    united.weight += weight;
  }

  [[nodiscard]] std::vector<Point> points() const {
    std::vector<Point> result;
    for (const United& united : points_) {
      if (united.track.size() < 2) continue;
      Point& point = result.emplace_back();
      point.position = united.sum / united.weight;
      for (int k = 0; k < 3; ++k)
        point.color[k] = cv::saturate_cast<std::uint8_t>(united.color[k] / united.weight);
      point.track = united.track;
    }
    return result;
  }

 private:
  struct United {
    std::vector<Observation> track;  // by image
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    cv::Vec3d color;
    double weight = 0;
  };

  static void sort_by_image(std::vector<Observation>& track) {
    std::sort(track.begin(), track.end(),
              [](const Observation& a, const Observation& b) { return a.image < b.image; });
  }

  [[nodiscard]] int& owner_of(const Observation& seen) {
    return owner_[at(seen.image)][at(seen.feature)];
  }

  void take(int point, const std::vector<Observation>& track) {
    for (const Observation& seen : track) owner_of(seen) = point;
    std::vector<Observation>& all = points_[at(point)].track;
    all.insert(all.end(), track.begin(), track.end());
    sort_by_image(all);
  }

  // Whether an image shows both, with different features.
  static bool shows_another(const std::vector<Observation>& a, const std::vector<Observation>& b) {
    for (auto p = a.begin(), q = b.begin(); p != a.end() && q != b.end();) {
      if (p->image == q->image && p->feature != q->feature) return true;
      p->image < q->image ? static_cast<void>(++p) : static_cast<void>(++q);
    }
    return false;
  }

  std::vector<std::vector<int>> owner_;  // of each feature: its point, or -1
  std::vector<United> points_;
};

// Mean cameras of the models; whether they differed.
bool join_cameras(const std::vector<const Model*>& models, Model& joined) {
  bool differs = false;
  for (std::size_t c = 0; c < joined.cameras.size(); ++c) {
    geometry::Camera mean;
    double weight = 0;
    double most = 0;
    for (const Model* model : models) {
      const auto images = static_cast<double>(std::count_if(
          model->images.begin(), model->images.end(),
          [&](const Image& image) { return image.registered && at(image.camera) == c; }));
      if (images == 0) continue;
      const geometry::Camera& camera = model->cameras[c];
      const geometry::Camera before = weight > 0 ? mean : camera;
      differs = differs || before.fx != camera.fx || before.fy != camera.fy ||
                before.cx != camera.cx || before.cy != camera.cy ||
                before.distortion != camera.distortion;
      if (images > most) {
        joined.cameras[c] = camera;
        most = images;
      }
      weight += images;
      const auto add = [&](double& value, double old, double other) {
        value = old + (other - old) * images / weight;
      };
      mean = camera;
      add(mean.fx, before.fx, camera.fx);
      add(mean.fy, before.fy, camera.fy);
      add(mean.cx, before.cx, camera.cx);
      add(mean.cy, before.cy, camera.cy);
      for (std::size_t k = 0; k < mean.distortion.size(); ++k)
        add(mean.distortion[k], before.distortion[k], camera.distortion[k]);
    }
    if (weight == 0) continue;
    geometry::Camera& camera = joined.cameras[c];
    camera.fx = mean.fx;
    camera.fy = mean.fy;
    camera.cx = mean.cx;
    camera.cy = mean.cy;
    camera.distortion = mean.distortion;
  }
  return differs;
}

int points_shown(const Image& image) {
  return static_cast<int>(std::count_if(image.points.begin(), image.points.end(),
                                        [](int point) { return point >= 0; }));
}

// Points in a row, those that enough images show; what each feature shows, and errors.
void put_in_order(Model& model, int min_views) {
  const std::size_t min_track = registered_of(model) < 4 ? 2 : at(std::max(2, min_views));
  for (Image& image : model.images) {
    if (image.registered)
      image.points.assign(image.features.size(), -1);
    else
      image.points.clear();
  }
  std::vector<Point> kept;
  for (Point& point : model.points) {
    if (point.track.size() < min_track) continue;
    double squares = 0;
    for (const Observation& seen : point.track) {
      const auto error = IncrementalMapper::error_of(model, seen, point.position);
      squares += error ? *error * *error : 0;
      model.images[at(seen.image)].points[at(seen.feature)] = static_cast<int>(kept.size());
    }
    point.error = std::sqrt(squares / static_cast<double>(point.track.size()));
    kept.push_back(std::move(point));
  }
  model.points = std::move(kept);
}

class Builder {
 public:
  Builder(const std::vector<Model>& models, const std::vector<std::string>& names,
          const MapperOptions& options, JoinedModels& result)
      : models_(models),
        names_(names),
        options_(options),
        log_(result.log),
        left_out_(result.left_out) {}

  // `members`: models, the one whose frame is kept first; `places`: into that frame.
  Model build(const std::vector<int>& members, const std::vector<Sim3>& places,
              const std::stop_token& stop) {
    Model joined;
    const Model& root = models_[at(members.front())];
    joined.cameras = root.cameras;
    joined.images.resize(root.images.size());
    for (std::size_t i = 0; i < joined.images.size(); ++i)
      take_image(members, places, static_cast<int>(i), joined);
    std::vector<const Model*> parts;
    for (const int member : members) parts.push_back(&models_[at(member)]);
    const bool differs = join_cameras(parts, joined);
    leave_out_disputed(members, places, joined);
    UnitedPoints united(joined.images);
    for (std::size_t m = 0; m < members.size(); ++m) {
      const Model& part = models_[at(members[m])];
      std::vector<char> is_same(part.images.size(), 0);
      for (std::size_t i = 0; i < part.images.size(); ++i)
        is_same[i] = part.images[i].registered && joined.images[i].registered &&
                             has_same_features(part.images[i], joined.images[i])
                         ? 1
                         : 0;
      for (const Point& point : part.points) {
        std::vector<Observation> track = point.track;
        std::erase_if(track, [&](const Observation& seen) { return is_same[at(seen.image)] == 0; });
        if (!track.empty()) united.add(point, places[m] * point.position, std::move(track));
      }
    }
    joined.points = united.points();
    adjust_all(joined, differs, stop);
    keep_what_hangs_together(joined);
    return joined;
  }

 private:
  static bool is_near(const Image& image, const Sim3& place, const Image& joined, double extent) {
    const geometry::Rigid3 moved = geometry::moved_camera(image.pose, place);
    return geometry::angle_of(moved.rotation.transpose() * joined.pose.rotation) * kDegrees <=
               kMaxOpenDeg &&
           (moved.center() - joined.pose.center()).norm() <= kMaxOpenShare * extent;
  }

  void leave_out(Model& joined, int i, std::string reason) {
    Image empty;
    empty.name = joined.images[at(i)].name;
    empty.camera = joined.images[at(i)].camera;
    joined.images[at(i)] = std::move(empty);
    log_.push_back(fmt::format("{} is left out: {}", joined.images[at(i)].name, reason));
    left_out_[i] = std::move(reason);
  }

  // Images that two of the models have at different places: nothing says which is right.
  void leave_out_disputed(const std::vector<int>& members, const std::vector<Sim3>& places,
                          Model& joined) {
    const double extent = extent_of(joined);
    for (std::size_t i = 0; i < joined.images.size(); ++i) {
      for (std::size_t m = 0; m < members.size() && joined.images[i].registered; ++m) {
        const Image& given = models_[at(members[m])].images[i];
        if (given.registered && !is_near(given, places[m], joined.images[i], extent))
          leave_out(
              joined, static_cast<int>(i),
              fmt::format("it lies elsewhere in {} than in another part", names_[at(members[m])]));
      }
    }
  }

  void take_image(const std::vector<int>& members, const std::vector<Sim3>& places, int i,
                  Model& joined) const {
    int most = -1;
    Image& image = joined.images[at(i)];
    image.name = models_[at(members.front())].images[at(i)].name;
    image.camera = models_[at(members.front())].images[at(i)].camera;
    for (std::size_t m = 0; m < members.size(); ++m) {
      const Image& given = models_[at(members[m])].images[at(i)];
      if (!given.registered) continue;
      const int shown = points_shown(given);
      if (shown <= most) continue;
      most = shown;
      image = given;
      image.pose = geometry::moved_camera(given.pose, places[m]);
    }
  }

  void adjust_all(Model& joined, bool differs, const std::stop_token& stop) {
    BundleOptions how;
    std::int64_t observations = 0;
    for (const Point& point : joined.points)
      observations += static_cast<std::int64_t>(point.track.size());
    how.max_observations = observations > kManyObservations ? kMaxObservations : 0;
    for (const double loss : kLosses) {
      const bool is_first = loss == kLosses[0];
      how.loss_px = loss;
      how.tolerance = is_first ? 1e-3 : 1e-5;
      how.focal = !is_first && (options_.refine_focal || differs);
      how.distortion = !is_first && (options_.refine_distortion || differs);
      how.center = !is_first && options_.refine_center;
      note(adjust(joined, how, stop));
      if (how.max_observations > 0) {
        BundleOptions alone;
        alone.loss_px = loss;
        alone.only_points = true;
        alone.points.resize(joined.points.size());
        std::iota(alone.points.begin(), alone.points.end(), 0);
        note(adjust(joined, alone, stop));
      }
      if (is_first) continue;
      (void)filter_points(joined, options_);
      std::erase_if(joined.points, [](const Point& point) { return point.track.empty(); });
    }
    put_in_order(joined, options_.min_views);
  }

  void note(const BundleReport& report) {
    if (!report.trouble.empty())
      log_.push_back(fmt::format("the adjustment of a joined model: {}", report.trouble));
  }

  void keep_what_hangs_together(Model& joined) {
    std::vector<char> was(joined.images.size(), 0);
    for (std::size_t i = 0; i < was.size(); ++i) was[i] = joined.images[i].registered ? 1 : 0;
    if (keep_largest_part(joined) == 0) return;
    for (std::size_t i = 0; i < was.size(); ++i)
      if (was[i] != 0 && !joined.images[i].registered)
        leave_out(joined, static_cast<int>(i),
                  "too few points that two others show say where it is");
  }

  const std::vector<Model>& models_;
  const std::vector<std::string>& names_;
  const MapperOptions& options_;
  std::vector<std::string>& log_;
  std::map<int, std::string>& left_out_;
};

void require_same_images(const std::vector<Model>& models) {
  for (const Model& model : models) {
    const Model& first = models.front();
    TARSIER_REQUIRE(
        model.images.size() == first.images.size() && model.cameras.size() == first.cameras.size(),
        "models of {} and {} images", first.images.size(), model.images.size());
    for (std::size_t i = 0; i < model.images.size(); ++i)
      TARSIER_REQUIRE(model.images[i].name == first.images[i].name &&
                          model.images[i].camera == first.images[i].camera,
                      "image {} is '{}' and '{}'", i, first.images[i].name, model.images[i].name);
  }
}

std::string line_of(const ModelJoin& join, const std::vector<std::string>& names) {
  const std::string what =
      fmt::format("{} and {}: {} images and {} points in common", names[at(join.first)],
                  names[at(join.second)], join.images, join.points);
  if (!join.refusal.empty()) return fmt::format("not joined: {}: {}", what, join.refusal);
  return fmt::format("joined: {}, of which {} and {} agree; scale {:.4f} +- {:.2g}", what,
                     join.agreeing, join.inliers, join.first_from_second.scale,
                     join.first_from_second.scale * join.scale_error);
}

// Which two have images in common.
std::vector<ModelJoin> neighbours_of(const std::vector<Model>& models) {
  std::vector<std::vector<int>> models_of(models.front().images.size());
  for (std::size_t m = 0; m < models.size(); ++m)
    for (std::size_t i = 0; i < models[m].images.size(); ++i)
      if (models[m].images[i].registered) models_of[i].push_back(static_cast<int>(m));
  std::vector<std::pair<int, int>> pairs;
  for (const std::vector<int>& of : models_of)
    for (std::size_t a = 0; a < of.size(); ++a)
      for (std::size_t b = a + 1; b < of.size(); ++b) pairs.emplace_back(of[a], of[b]);
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  std::vector<ModelJoin> joins;
  for (const auto& [first, second] : pairs) {
    joins.emplace_back();
    joins.back().first = first;
    joins.back().second = second;
  }
  return joins;
}

}  // namespace

ModelJoin find_join(const Model& first, const Model& second, const JoinOptions& options) {
  return Joining(first, second, options).run();
}

JoinedModels join_models(const std::vector<Model>& models, const std::vector<std::string>& names,
                         const JoinOptions& options, const MapperOptions& mapper,
                         const std::stop_token& stop) {
  TARSIER_REQUIRE(names.size() == models.size(), "{} names of {} models", names.size(),
                  models.size());
  JoinedModels result;
  if (models.empty()) return result;
  require_same_images(models);
  result.joins = neighbours_of(models);
  cv::parallel_for_(cv::Range(0, static_cast<int>(result.joins.size())),
                    [&](const cv::Range& range) {
                      for (int k = range.start; k < range.end && !stop.stop_requested(); ++k) {
                        ModelJoin& join = result.joins[at(k)];
                        const auto [first, second] = std::pair(join.first, join.second);
                        join = find_join(models[at(first)], models[at(second)], options);
                        join.first = first;
                        join.second = second;
                      }
                    });
  throw_if_stopped(stop);
  Groups groups(models, result.joins);
  groups.run(stop);
  for (const ModelJoin& join : result.joins) result.log.push_back(line_of(join, names));

  std::vector<std::vector<int>> members = groups.members();
  std::vector<Model> made;
  for (const std::vector<int>& group : members) {
    if (group.size() == 1) {
      made.push_back(models[at(group.front())]);
      if (models.size() > 1)
        result.log.push_back(fmt::format("{} is joined to nothing", names[at(group.front())]));
      continue;
    }
    std::vector<Sim3> places;
    for (const int model : group) places.push_back(groups.place(model, group.front()));
    made.push_back(Builder(models, names, mapper, result).build(group, places, stop));
  }
  std::vector<std::size_t> order(made.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return registered_of(made[a]) > registered_of(made[b]);
  });
  result.joined_in.assign(models.size(), 0);
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (const int model : members[order[k]]) result.joined_in[at(model)] = static_cast<int>(k);
    result.models.push_back(std::move(made[order[k]]));
  }
  return result;
}

std::vector<Model> with_same_images(const std::vector<Model>& models) {
  // Cameras that images say are the same: (model, camera) as numbers, joined.
  std::vector<int> first_camera;
  std::vector<const geometry::Camera*> all;
  for (const Model& model : models) {
    first_camera.push_back(static_cast<int>(all.size()));
    for (const geometry::Camera& camera : model.cameras) all.push_back(&camera);
  }
  Components same(all.size());
  std::map<std::string, int> index;  // of each name
  std::vector<std::string> names;
  std::vector<int> camera_of;  // of each image: one of `all`
  for (std::size_t m = 0; m < models.size(); ++m) {
    for (const Image& image : models[m].images) {
      const int camera = first_camera[m] + image.camera;
      const auto [entry, fresh] = index.try_emplace(image.name, static_cast<int>(names.size()));
      if (fresh) {
        names.push_back(image.name);
        camera_of.push_back(camera);
        continue;
      }
      const geometry::Camera& a = *all[at(camera)];
      const geometry::Camera& b = *all[at(camera_of[at(entry->second)])];
      if (a.width == b.width && a.height == b.height && a.lens == b.lens)
        (void)same.join(camera, camera_of[at(entry->second)]);
    }
  }
  std::map<int, int> number;  // of each root
  std::vector<int> cameras;   // the first of each that is the same
  for (std::size_t c = 0; c < all.size(); ++c) {
    const int root = same.root(static_cast<int>(c));
    if (number.try_emplace(root, static_cast<int>(cameras.size())).second)
      cameras.push_back(static_cast<int>(c));
  }
  std::vector<Model> result;
  for (std::size_t m = 0; m < models.size(); ++m) {
    Model& made = result.emplace_back();
    for (const int camera : cameras) made.cameras.push_back(*all[at(camera)]);
    for (std::size_t c = 0; c < models[m].cameras.size(); ++c)
      made.cameras[at(number.at(same.root(first_camera[m] + static_cast<int>(c))))] =
          models[m].cameras[c];
    made.images.resize(names.size());
    for (std::size_t i = 0; i < names.size(); ++i) {
      made.images[i].name = names[i];
      made.images[i].camera = number.at(same.root(camera_of[i]));
    }
    std::vector<int> place(models[m].images.size(), -1);
    for (std::size_t i = 0; i < models[m].images.size(); ++i) {
      const Image& given = models[m].images[i];
      const int to = index.at(given.name);
      if (number.at(same.root(first_camera[m] + given.camera)) != made.images[at(to)].camera)
        continue;
      place[i] = to;
      const int camera = made.images[at(to)].camera;
      made.images[at(to)] = given;
      made.images[at(to)].camera = camera;
      made.images[at(to)].points.assign(given.features.size(), -1);
    }
    for (const Point& point : models[m].points) {
      Point copy = point;
      copy.track.clear();
      for (const Observation& seen : point.track)
        if (place[at(seen.image)] >= 0) copy.track.push_back({place[at(seen.image)], seen.feature});
      if (copy.track.size() < 2) continue;
      for (const Observation& seen : copy.track)
        made.images[at(seen.image)].points[at(seen.feature)] = static_cast<int>(made.points.size());
      made.points.push_back(std::move(copy));
    }
  }
  return result;
}

}  // namespace tarsier::sfm
