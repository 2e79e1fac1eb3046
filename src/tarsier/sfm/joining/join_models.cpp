// SPDX-License-Identifier: MIT
#include "tarsier/sfm/joining/join_models.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/joining/merged_points.h"
#include "tarsier/sfm/joining/model_groups.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/model_parts.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

using geometry::Sim3;

// Losses for adjusting a joined model, from rough to fine: with an open cycle, errors are initially
// large.
constexpr double kLossesPx[] = {8, 2, 0.5};  // px
constexpr std::int64_t kManyObservations = 1'000'000;
constexpr int kMaxJoinedObservations = 40;  // per point, where there are many

// Sets mean cameras of the models; returns whether they differed.
bool join_cameras(const std::vector<const Model*>& models, Model& joined) {
  bool differs = false;
  for (std::size_t c = 0; c < joined.cameras.size(); ++c) {
    geometry::Camera mean;
    double weight = 0;
    double max_images = 0;
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
      if (images > max_images) {
        joined.cameras[c] = camera;
        max_images = images;
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

int observed_points(const Image& image) {
  return static_cast<int>(std::count_if(image.points.begin(), image.points.end(),
                                        [](int point) { return point >= 0; }));
}

// Keeps the points that enough images show, numbers them, and sets the points of features and the
// errors.
void finalize_points(Model& model, int min_views) {
  const std::size_t min_track = registered_count(model) < 4 ? 2 : at(std::max(2, min_views));
  for (Image& image : model.images) {
    if (image.registered)
      image.points.assign(image.features.size(), -1);
    else
      image.points.clear();
  }
  std::vector<Point> remaining;
  for (Point& point : model.points) {
    if (point.track.size() < min_track) continue;
    double squares = 0;
    for (const Observation& seen : point.track) {
      const auto error = IncrementalMapper::reprojection_error(model, seen, point.position);
      squares += error ? *error * *error : 0;
      model.images[at(seen.image)].points[at(seen.feature)] = static_cast<int>(remaining.size());
    }
    point.error = std::sqrt(squares / static_cast<double>(point.track.size()));
    remaining.push_back(std::move(point));
  }
  model.points = std::move(remaining);
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

  // `members`: models, first the one whose frame is used; `root_from_models`: transforms into that
  // frame.
  Model build(const std::vector<int>& members, const std::vector<Sim3>& root_from_models,
              const std::stop_token& stop) {
    Model joined;
    const Model& root = models_[at(members.front())];
    joined.cameras = root.cameras;
    joined.images.resize(root.images.size());
    for (std::size_t i = 0; i < joined.images.size(); ++i)
      choose_image(members, root_from_models, static_cast<int>(i), joined);
    std::vector<const Model*> parts;
    parts.reserve(members.size());
    for (const int member : members) parts.push_back(&models_[at(member)]);
    const bool differs = join_cameras(parts, joined);
    drop_contradicted_images(members, root_from_models, joined);
    MergedPoints merged(joined.images);
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
        if (!track.empty())
          merged.add(point, root_from_models[m] * point.position, std::move(track));
      }
    }
    joined.points = merged.points();
    adjust_all(joined, differs, stop);
    keep_connected_part(joined);
    return joined;
  }

 private:
  static bool is_near(const Image& image, const Sim3& root_from_model, const Image& joined,
                      double extent) {
    const geometry::Rigid3 moved = geometry::moved_camera(image.pose, root_from_model);
    return geometry::angle_of(moved.rotation.transpose() * joined.pose.rotation) *
                   kDegreesPerRadian <=
               kMaxLoopDeg &&
           (moved.center() - joined.pose.center()).norm() <= kMaxLoopShare * extent;
  }

  void drop_image(Model& joined, int i, std::string reason) {
    Image empty;
    empty.name = joined.images[at(i)].name;
    empty.camera = joined.images[at(i)].camera;
    joined.images[at(i)] = std::move(empty);
    log_.push_back(fmt::format("{} is left out: {}", joined.images[at(i)].name, reason));
    left_out_[i] = std::move(reason);
  }

  // Leaves out images that two models place differently: it is unknown which is right.
  void drop_contradicted_images(const std::vector<int>& members,
                                const std::vector<Sim3>& root_from_models, Model& joined) {
    const double extent = extent_of(joined);
    for (std::size_t i = 0; i < joined.images.size(); ++i) {
      for (std::size_t m = 0; m < members.size() && joined.images[i].registered; ++m) {
        const Image& given = models_[at(members[m])].images[i];
        if (given.registered && !is_near(given, root_from_models[m], joined.images[i], extent))
          drop_image(joined, static_cast<int>(i),
                     fmt::format("its camera pose in {} differs from that in another part",
                                 names_[at(members[m])]));
      }
    }
  }

  void choose_image(const std::vector<int>& members, const std::vector<Sim3>& root_from_models,
                    int i, Model& joined) const {
    int max_points = -1;
    Image& image = joined.images[at(i)];
    image.name = models_[at(members.front())].images[at(i)].name;
    image.camera = models_[at(members.front())].images[at(i)].camera;
    for (std::size_t m = 0; m < members.size(); ++m) {
      const Image& given = models_[at(members[m])].images[at(i)];
      if (!given.registered) continue;
      const int points = observed_points(given);
      if (points <= max_points) continue;
      max_points = points;
      image = given;
      image.pose = geometry::moved_camera(given.pose, root_from_models[m]);
    }
  }

  void adjust_all(Model& joined, bool differs, const std::stop_token& stop) {
    BundleOptions bundle;
    std::int64_t observations = 0;
    for (const Point& point : joined.points)
      observations += static_cast<std::int64_t>(point.track.size());
    bundle.max_observations = observations > kManyObservations ? kMaxJoinedObservations : 0;
    for (const double loss : kLossesPx) {
      const bool is_first = loss == kLossesPx[0];
      bundle.loss_px = loss;
      bundle.tolerance = is_first ? 1e-3 : 1e-5;
      bundle.focal = !is_first && (options_.refine_focal || differs);
      bundle.distortion = !is_first && (options_.refine_distortion || differs);
      bundle.center = !is_first && options_.refine_center;
      log_adjustment(adjust(joined, bundle, stop));
      if (bundle.max_observations > 0) {
        BundleOptions points_only;
        points_only.loss_px = loss;
        points_only.only_points = true;
        points_only.points.resize(joined.points.size());
        std::iota(points_only.points.begin(), points_only.points.end(), 0);
        log_adjustment(adjust(joined, points_only, stop));
      }
      if (is_first) continue;
      (void)filter_points(joined, options_);
      std::erase_if(joined.points, [](const Point& point) { return point.track.empty(); });
    }
    finalize_points(joined, options_.min_views);
  }

  void log_adjustment(const BundleReport& report) {
    if (!report.warning.empty())
      log_.push_back(fmt::format("bundle adjustment of a joined model: {}", report.warning));
  }

  void keep_connected_part(Model& joined) {
    std::vector<char> was(joined.images.size(), 0);
    for (std::size_t i = 0; i < was.size(); ++i) was[i] = joined.images[i].registered ? 1 : 0;
    if (keep_largest_part(joined) == 0) return;
    for (std::size_t i = 0; i < was.size(); ++i)
      if (was[i] != 0 && !joined.images[i].registered)
        drop_image(joined, static_cast<int>(i),
                   "it shares too few points with two or more other images");
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
                      "image {} is named '{}' and '{}'", i, first.images[i].name,
                      model.images[i].name);
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

// The pairs of models with common images.
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

JoinedModels join_models(const std::vector<Model>& models, const std::vector<std::string>& names,
                         const JoinOptions& options, const MapperOptions& mapper,
                         const std::stop_token& stop) {
  TARSIER_REQUIRE(names.size() == models.size(), "{} names for {} models", names.size(),
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
  ModelGroups groups(models, result.joins);
  groups.run(stop);
  for (const ModelJoin& join : result.joins) result.log.push_back(line_of(join, names));

  std::vector<std::vector<int>> members = groups.members();
  std::vector<Model> made;
  for (const std::vector<int>& group : members) {
    if (group.size() == 1) {
      made.push_back(models[at(group.front())]);
      if (models.size() > 1)
        result.log.push_back(
            fmt::format("{} is not joined to any other model", names[at(group.front())]));
      continue;
    }
    std::vector<Sim3> root_from_models;
    root_from_models.reserve(group.size());
    for (const int model : group)
      root_from_models.push_back(groups.root_from_model(model, group.front()));
    made.push_back(Builder(models, names, mapper, result).build(group, root_from_models, stop));
  }
  std::vector<std::size_t> order(made.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return registered_count(made[a]) > registered_count(made[b]);
  });
  result.joined_in.assign(models.size(), 0);
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (const int model : members[order[k]]) result.joined_in[at(model)] = static_cast<int>(k);
    result.models.push_back(std::move(made[order[k]]));
  }
  return result;
}

}  // namespace tarsier::sfm
