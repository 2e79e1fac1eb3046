// SPDX-License-Identifier: MIT
// IncrementalMapper::extend_tracks(): tracks of the model get longer, and two that are one point
// are merged.
#include "tarsier/core/at.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/consistency/feature_grid.h"
#include "tarsier/sfm/features/matching.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kFailedOfTrack = 16;  // remembered failed pairs of tracks, per track
constexpr std::size_t kMaxFailed = std::size_t{1} << 22;  // .. and in total
// views of a point compared with a feature, evenly spread
constexpr std::size_t kMaxComparedViews = 12;
constexpr std::size_t kMaxMergeRays = 64;     // for two points that may be one, evenly spread
constexpr std::size_t kMinReliableViews = 6;  // min views of a point whose position is reliable
constexpr double kMinDistinctError = 4;  // in units of reprojection_px: such points are different

// Pairs of tracks that are not one point. A hash table of fixed size: an overwritten pair is tested
// again.
class FailedMerges {
 public:
  explicit FailedMerges(std::size_t tracks)
      : pairs_(std::bit_ceil(std::clamp(kFailedOfTrack * tracks, kFailedOfTrack, kMaxFailed))) {}

  // `size`: of both tracks. A pair that failed at another size may succeed now.
  [[nodiscard]] bool contains(int track, int other, std::size_t size) const {
    const std::uint64_t key = key_of(track, other);
    const Pair& pair = pairs_[slot_of(key)];
    return pair.key == key && (pair.size == kAnySize || pair.size == size);
  }
  void insert(int track, int other, std::size_t size) {
    const std::uint64_t key = key_of(track, other);
    pairs_[slot_of(key)] = {key, static_cast<std::uint32_t>(size)};
  }
  // Remembers the pair for all sizes.
  void insert_for_all_sizes(int track, int other) { insert(track, other, kAnySize); }

 private:
  static constexpr std::uint32_t kAnySize = 0;
  struct Pair {
    std::uint64_t key = 0;  // unused: a track is not paired with itself
    std::uint32_t size = 0;
  };
  static std::uint64_t key_of(int track, int other) {
    const auto [low, high] = std::minmax(track, other);
    return static_cast<std::uint64_t>(low) << 32 | static_cast<std::uint32_t>(high);
  }
  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const {
    return static_cast<std::size_t>(key * kMix >> 20) & (pairs_.size() - 1);
  }
  static constexpr std::uint64_t kMix = 0x9e3779b97f4a7c15;  // 2^64 / golden ratio
  std::vector<Pair> pairs_;
};

// A set of tracks, as bits.
class TrackSet {
 public:
  explicit TrackSet(std::size_t tracks) : words_((tracks + 63) / 64, 0) {}

  void insert(int track) { words_[at(track) / 64] |= bit_of(track); }
  void erase(int track) { words_[at(track) / 64] &= ~bit_of(track); }
  // Visits all in ascending order and empties the set.
  template <typename Visit>
  void take_all(const Visit& visit) {
    for (std::size_t w = 0; w < words_.size(); ++w) {
      for (std::uint64_t left = words_[w]; left != 0; left &= left - 1)
        visit(static_cast<int>(64 * w) + std::countr_zero(left));
      words_[w] = 0;
    }
  }

 private:
  static std::uint64_t bit_of(int track) { return std::uint64_t{1} << (at(track) % 64); }
  std::vector<std::uint64_t> words_;
};

}  // namespace

int IncrementalMapper::extend_tracks(const std::stop_token& stop) {
  if (descriptors_.empty() || options_.extend_px <= 0) return 0;
  int gained = 0;
  // The points that each image observes initially. Later additions are not considered.
  std::vector<std::vector<int>> tracks_of_image(model_.images.size());
  for (std::size_t t = 0; t < tracks_.size(); ++t)
    for (const Observation& seen : model_.points[t].track)
      tracks_of_image[at(seen.image)].push_back(static_cast<int>(t));
  norms_.resize(descriptors_.size());
  for (std::size_t i = 0; i < norms_.size(); ++i)
    if (norms_[i].empty()) norms_[i] = norms_of(descriptors_[i], kind_);
  TrackSet nearby(tracks_.size());
  std::vector<int> covisible_with(model_.images.size(), -1);
  // for each image: the last track that contains it
  std::vector<int> last_track_of_image(model_.images.size(), -1);
  // for each track: the last image with a feature that joined it
  std::vector<int> joined_in(tracks_.size(), -1);
  std::vector<int> features;
  FailedMerges failed(tracks_.size());
  const auto size_of = [&](int track, int other) {
    std::size_t size = 0;
    for (const int one : {track, other})
      size += model_.points[at(one)].track.size() + tracks_[at(one)].size();
    return size;
  };
  for (std::size_t i = 0; i < model_.images.size(); ++i) {
    if (!model_.images[i].registered) continue;
    throw_if_stopped(stop);
    const int image = static_cast<int>(i);
    const Image& view = model_.images[i];
    const geometry::Camera& camera = model_.cameras[at(view.camera)];
    std::vector<int> covisible;
    for (const int track : tracks_of_image[i]) {
      for (const Observation& seen : model_.points[at(track)].track) {
        if (covisible_with[at(seen.image)] == image) continue;
        covisible_with[at(seen.image)] = image;
        covisible.push_back(seen.image);
      }
    }
    for (const int other : covisible)
      for (const int track : tracks_of_image[at(other)]) nearby.insert(track);
    for (const int track : tracks_of_image[i]) nearby.erase(track);  // observed already
    std::vector<std::pair<int, cv::Point2d>> candidates;             // with expected positions
    nearby.take_all([&](int track) {
      const auto pixel = camera.project(view.pose * model_.points[at(track)].position);
      if (pixel && pixel->x >= 0 && pixel->y >= 0 && pixel->x < camera.width &&
          pixel->y < camera.height) {
        candidates.emplace_back(track, *pixel);
      }
    });
    const FeatureGrid grid(view.features, camera, options_.extend_px);
    for (const auto& [track, pixel] : candidates) {
      const std::vector<Observation>& seen = model_.points[at(track)].track;
      if (seen.empty() || joined_in[at(track)] == image) continue;
      const auto is_near = [&, predicted = pixel](int feature) {
        return cv::norm(predicted - cv::Point2d(view.features[at(feature)])) <=
               options_.reprojection_px;
      };
      features.clear();
      bool may_join = false;
      grid.for_each(pixel.x, pixel.y, [&](int feature) {
        features.push_back(feature);
        const int other = track_of_[i][at(feature)];
        may_join = may_join || (other < 0 ? is_near(feature)
                                          : !failed.contains(track, other, size_of(track, other)));
      });
      if (!may_join) continue;
      for (const Observation& own : tracks_[at(track)]) last_track_of_image[at(own.image)] = track;
      if (last_track_of_image[i] == track)
        continue;  // its own feature there was dropped as an outlier
      const auto shares_an_image = [&](int other) {
        const std::vector<Observation>& theirs = tracks_[at(other)];
        return std::any_of(theirs.begin(), theirs.end(), [&](const Observation& one) {
          return last_track_of_image[at(one.image)] == track;
        });
      };
      bool can_join = false;
      for (const int feature : features) {
        const int other = track_of_[i][at(feature)];
        if (other < 0) {
          can_join = can_join || is_near(feature);
        } else if (!failed.contains(track, other, size_of(track, other))) {
          if (shares_an_image(other)) {
            failed.insert_for_all_sizes(track, other);
          } else {
            can_join = true;
          }
        }
      }
      if (!can_join) continue;
      const int feature = best_match(track, image, features);
      if (feature < 0) continue;
      const int other = track_of_[i][at(feature)];
      if (other >= 0 && shares_an_image(other)) continue;
      const int joined = merge(track, {image, feature});
      gained += joined;
      if (joined > 0) joined_in[at(track)] = image;
      if (joined > 0 || other < 0) continue;
      if (std::min(seen.size(), model_.points[at(other)].track.size()) >= kMinReliableViews) {
        failed.insert_for_all_sizes(track, other);
      } else {
        failed.insert(track, other, size_of(track, other));
      }
    }
  }
  return gained;
}

int IncrementalMapper::best_match(int track, int image, const std::vector<int>& features) const {
  int best_feature = -1;
  double best_similarity = options_.extend_similarity;
  const std::vector<Observation>& views = model_.points[at(track)].track;
  const std::size_t stride = (views.size() + kMaxComparedViews - 1) / kMaxComparedViews;
  for (const int feature : features) {
    double max_similarity = 0;
    for (std::size_t k = 0; k < views.size(); k += stride) {
      const Observation& seen = views[k];
      max_similarity = std::max(
          max_similarity,
          similarity(descriptors_[at(image)], feature, descriptors_[at(seen.image)], seen.feature,
                     kind_,
                     norms_[at(image)][at(feature)] * norms_[at(seen.image)][at(seen.feature)]));
    }
    if (max_similarity > best_similarity) {
      best_similarity = max_similarity;
      best_feature = feature;
    }
  }
  return best_feature;
}

bool IncrementalMapper::are_distinct(const Point& point, const Point& other) const {
  if (std::min(point.track.size(), other.track.size()) < kMinReliableViews) return false;
  const auto is_outlier = [&](const Observation& seen) {
    const auto error = reprojection_error(model_, seen, point.position);
    return !error || *error > kMinDistinctError * options_.reprojection_px;
  };
  return is_outlier(other.track.front()) || is_outlier(other.track.back());
}

int IncrementalMapper::merge(int track, const Observation& seen) {
  std::vector<Observation>& own = tracks_[at(track)];
  Point& point = model_.points[at(track)];
  const int other = track_of_[at(seen.image)][at(seen.feature)];
  if (other == track) return 0;  // dropped as an outlier
  if (other < 0) {
    const auto error = reprojection_error(model_, seen, point.position);
    if (!error || *error > options_.reprojection_px) return 0;
    extended_ = true;
    own.push_back(seen);
    point.track.push_back(seen);
    track_of_[at(seen.image)][at(seen.feature)] = track;
    count(seen, 1);
    return 1;
  }
  // Two tracks are one point if all their rays agree.
  std::vector<Observation>& theirs = tracks_[at(other)];
  if (are_distinct(point, model_.points[at(other)])) return 0;
  std::vector<Observation> all = point.track;
  const std::vector<Observation>& more =
      model_.points[at(other)].track.empty() ? theirs : model_.points[at(other)].track;
  for (const Observation& observation : more)
    if (model_.images[at(observation.image)].registered) all.push_back(observation);
  std::vector<ObservationRay> rays;
  const std::size_t stride = (all.size() + kMaxMergeRays - 1) / kMaxMergeRays;
  for (std::size_t k = 0; k < all.size(); k += stride) rays.push_back(ray_of(all[k]));
  const auto position = triangulate(rays);
  if (!position || !std::all_of(all.begin(), all.end(), [&](const Observation& one) {
        const auto error = reprojection_error(model_, one, *position);
        return error && *error <= options_.reprojection_px;
      }))
    return 0;
  const int gained =
      static_cast<int>(all.size() - point.track.size() - model_.points[at(other)].track.size());
  extended_ = true;
  for (const Observation& observation : theirs) {
    own.push_back(observation);
    track_of_[at(observation.image)][at(observation.feature)] = track;
    if (is_point_[at(other)] == 0) count(observation, 1);  // otherwise it is counted already
  }
  is_point_[at(other)] = 0;
  theirs.clear();
  model_.points[at(other)] = {};
  point.position = *position;
  point.track = std::move(all);
  return std::max(gained, 1);
}

}  // namespace tarsier::sfm
