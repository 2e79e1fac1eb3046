// SPDX-License-Identifier: MIT
// IncrementalMapper::extend_tracks(): tracks of the model get longer, and two that are one point are merged.
#include "tarsier/core/stop.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/matching.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace tarsier::sfm {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

// The features of an image by place.
class IncrementalMapper::Nearby {
 public:
  Nearby(const Image& image, double radius) : radius_(radius), features_(image.features) {
    for (std::size_t f = 0; f < features_.size(); ++f)
      cells_[cell(features_[f].x, features_[f].y)].push_back(static_cast<int>(f));
  }
  template <typename Function>
  void for_each(const cv::Point2d& p, const Function& function) const {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const auto found = cells_.find(cell(p.x + dx * radius_, p.y + dy * radius_));
        if (found == cells_.end()) continue;
        for (const int f : found->second)
          if (cv::norm(cv::Point2d(features_[at(f)]) - p) <= radius_) function(f);
      }
    }
  }

 private:
  [[nodiscard]] std::pair<int, int> cell(double x, double y) const {
    return {static_cast<int>(std::floor(x / radius_)), static_cast<int>(std::floor(y / radius_))};
  }
  double radius_;
  const std::vector<cv::Point2f>& features_;
  std::map<std::pair<int, int>, std::vector<int>> cells_;
};

int IncrementalMapper::extend_tracks(const std::stop_token& stop) {
  if (descriptors_.empty() || options_.extend_px <= 0) return 0;
  int gained = 0;
  // Which points each image shows, at first: what comes in below is not looked at again.
  std::vector<std::vector<int>> shown(model_.images.size());
  for (std::size_t t = 0; t < tracks_.size(); ++t)
    for (const Observation& seen : model_.points[t].track)
      shown[at(seen.image)].push_back(static_cast<int>(t));
  norms_.resize(descriptors_.size());
  for (std::size_t i = 0; i < norms_.size(); ++i)
    if (norms_[i].empty()) norms_[i] = norms_of(descriptors_[i], kind_);
  std::vector<int> asked_for(tracks_.size(), -1);  // by the last image
  std::vector<int> covisible_with(model_.images.size(), -1);
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    if (!model_.images[i].registered) continue;
    throw_if_stopped(stop);
    const int image = static_cast<int>(i);
    const Image& view = model_.images[i];
    const geometry::Camera& camera = model_.cameras[at(view.camera)];
    std::vector<int> covisible;
    for (const int track : shown[i]) {
      asked_for[at(track)] = image;  // it is there already
      for (const Observation& seen : model_.points[at(track)].track) {
        if (covisible_with[at(seen.image)] == image) continue;
        covisible_with[at(seen.image)] = image;
        covisible.push_back(seen.image);
      }
    }
    std::vector<std::pair<int, cv::Point2d>> candidates;  // where they should be
    for (const int other : covisible) {
      for (const int track : shown[at(other)]) {
        if (asked_for[at(track)] == image) continue;
        asked_for[at(track)] = image;
        const auto pixel = camera.project(view.pose * model_.points[at(track)].position);
        if (pixel && pixel->x >= 0 && pixel->y >= 0 && pixel->x < camera.width &&
            pixel->y < camera.height) {
          candidates.emplace_back(track, *pixel);
        }
      }
    }
    std::sort(candidates.begin(), candidates.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    const Nearby nearby(view, options_.extend_px);
    for (const auto& [track, pixel] : candidates) {
      const std::vector<Observation>& seen = model_.points[at(track)].track;
      if (seen.empty() || shows(seen, image)) continue;  // joined to another meanwhile
      const int feature = look_for(track, image, pixel, nearby);
      if (feature >= 0) gained += merge(track, {image, feature});
    }
  }
  return gained;
}

int IncrementalMapper::look_for(int track, int image, const cv::Point2d& pixel,
                                const Nearby& nearby) const {
  const Point& point = model_.points[at(track)];
  int best = -1;
  double most = options_.extend_similarity;
  nearby.for_each(pixel, [&](int feature) {
    double likeness = 0;
    for (const Observation& seen : point.track)
      likeness = std::max(likeness, similarity(descriptors_[at(image)], feature,
                                               descriptors_[at(seen.image)], seen.feature, kind_,
                                               norms_[at(image)][at(feature)] *
                                                   norms_[at(seen.image)][at(seen.feature)]));
    if (likeness > most) {
      most = likeness;
      best = feature;
    }
  });
  return best;
}

int IncrementalMapper::merge(int track, const Observation& seen) {
  std::vector<Observation>& own = tracks_[at(track)];
  Point& point = model_.points[at(track)];
  const int other = track_of_[at(seen.image)][at(seen.feature)];
  if (other == track) return 0;  // it was dropped for being off
  if (other < 0) {
    const auto error = error_of(model_, seen, point.position);
    if (!error || *error > options_.reprojection_px || shows(own, seen.image)) return 0;
    extended_ = true;
    own.push_back(seen);
    point.track.push_back(seen);
    track_of_[at(seen.image)][at(seen.feature)] = track;
    count(seen, 1);
    return 1;
  }
  // Two tracks: one point if all their rays agree.
  std::vector<Observation>& theirs = tracks_[at(other)];
  for (const Observation& observation : theirs)
    if (shows(own, observation.image)) return 0;
  std::vector<Observation> all = point.track;
  const std::vector<Observation>& more =
      model_.points[at(other)].track.empty() ? theirs : model_.points[at(other)].track;
  for (const Observation& observation : more)
    if (model_.images[at(observation.image)].registered) all.push_back(observation);
  std::vector<ObservationRay> rays;
  for (const Observation& observation : all) rays.push_back(ray_of(observation));
  const auto position = triangulate(rays);
  if (!position || within(all, *position).size() != all.size()) return 0;
  const int gained =
      static_cast<int>(all.size() - point.track.size() - model_.points[at(other)].track.size());
  extended_ = true;
  for (const Observation& observation : theirs) {
    own.push_back(observation);
    track_of_[at(observation.image)][at(observation.feature)] = track;
    if (is_point_[at(other)] == 0) count(observation, 1);  // else it is counted already
  }
  is_point_[at(other)] = 0;
  theirs.clear();
  model_.points[at(other)] = {};
  point.position = *position;
  point.track = std::move(all);
  return std::max(gained, 1);
}

}  // namespace tarsier::sfm
