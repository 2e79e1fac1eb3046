// SPDX-License-Identifier: MIT
// IncrementalMapper::extend_tracks(): tracks of the model get longer, and two that are one point are merged.
#include "tarsier/core/stop.h"
#include "tarsier/sfm/mapper/feature_grid.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/matching.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMaxFailed = 4'000'000;
constexpr std::size_t kMaxCompared =
    12;  // views of a point, spread over all, that a feature is compared with
constexpr std::size_t kSureViews = 6;  // of a point that is not moved far by others
constexpr double kFarOff = 4;          // reprojection_px: two such points are not one

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// Pairs of tracks that are not one point, each with its size then: while these stay, so do the tracks.
class FailedMerges {
 public:
  [[nodiscard]] bool contains(int track, std::size_t size, int other,
                              std::size_t size_of_other) const {
    const auto found = sizes_.find(key(track, other));
    return found != sizes_.end() && found->second == sizes(track, size, other, size_of_other);
  }
  void insert(int track, std::size_t size, int other, std::size_t size_of_other) {
    if (sizes_.size() >= kMaxFailed) sizes_.clear();
    sizes_[key(track, other)] = sizes(track, size, other, size_of_other);
  }

 private:
  static std::uint64_t key(int track, int other) {
    const auto [low, high] = std::minmax(track, other);
    return static_cast<std::uint64_t>(low) << 32 | static_cast<std::uint32_t>(high);
  }
  static std::uint64_t sizes(int track, std::size_t size, int other, std::size_t size_of_other) {
    if (track > other) std::swap(size, size_of_other);
    return static_cast<std::uint64_t>(size) << 32 | static_cast<std::uint32_t>(size_of_other);
  }
  std::unordered_map<std::uint64_t, std::uint64_t> sizes_;
};

}  // namespace

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
  std::vector<int> shown_by(model_.images.size(), -1);  // the last track that an image is part of
  std::vector<int> features;
  FailedMerges failed;
  const auto size_of = [&](int track) {
    return model_.points[at(track)].track.size() + tracks_[at(track)].size();
  };
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
    const FeatureGrid grid(view.features, camera, options_.extend_px);
    for (const auto& [track, pixel] : candidates) {
      const std::vector<Observation>& seen = model_.points[at(track)].track;
      if (seen.empty() || shows(seen, image)) continue;  // joined to another meanwhile
      features.clear();
      grid.any(pixel.x, pixel.y, [&](int feature) {
        features.push_back(feature);
        return false;
      });
      if (features.empty()) continue;
      for (const Observation& own : tracks_[at(track)]) shown_by[at(own.image)] = track;
      if (shown_by[i] == track) continue;  // its feature there was dropped for being off
      const bool can_join = std::any_of(features.begin(), features.end(), [&](int feature) {
        const int other = track_of_[i][at(feature)];
        if (other < 0)
          return cv::norm(pixel - cv::Point2d(view.features[at(feature)])) <=
                 options_.reprojection_px;
        const std::vector<Observation>& theirs = tracks_[at(other)];
        return std::none_of(
                   theirs.begin(), theirs.end(),
                   [&](const Observation& one) { return shown_by[at(one.image)] == track; }) &&
               !failed.contains(track, size_of(track), other, size_of(other));
      });
      if (!can_join) continue;
      const int feature = best_match(track, image, features);
      if (feature < 0) continue;
      const int other = track_of_[i][at(feature)];
      const int joined = merge(track, {image, feature});
      gained += joined;
      if (joined > 0 || other < 0) continue;
      failed.insert(track, size_of(track), other, size_of(other));
    }
  }
  return gained;
}

int IncrementalMapper::best_match(int track, int image, const std::vector<int>& features) const {
  int best = -1;
  double most = options_.extend_similarity;
  const std::vector<Observation>& views = model_.points[at(track)].track;
  const std::size_t stride = (views.size() + kMaxCompared - 1) / kMaxCompared;
  for (const int feature : features) {
    double likeness = 0;
    for (std::size_t k = 0; k < views.size(); k += stride) {
      const Observation& seen = views[k];
      likeness = std::max(likeness, similarity(descriptors_[at(image)], feature,
                                               descriptors_[at(seen.image)], seen.feature, kind_,
                                               norms_[at(image)][at(feature)] *
                                                   norms_[at(seen.image)][at(seen.feature)]));
    }
    if (likeness > most) {
      most = likeness;
      best = feature;
    }
  }
  return best;
}

bool IncrementalMapper::are_apart(const Point& point, const Point& other) const {
  if (std::min(point.track.size(), other.track.size()) < kSureViews) return false;
  const auto is_off = [&](const Observation& seen) {
    const auto error = error_of(model_, seen, point.position);
    return !error || *error > kFarOff * options_.reprojection_px;
  };
  return is_off(other.track.front()) || is_off(other.track.back());
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
  if (are_apart(point, model_.points[at(other)])) return 0;
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
