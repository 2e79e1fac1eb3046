// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/point_selection.h"

#include "tarsier/core/at.h"
#include "tarsier/core/mixed_index.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <utility>

namespace tarsier::sfm {
namespace {

// min share of the observations that anchors must keep
constexpr double kMinObservationShare = 0.5;

// Selects `share` of `count` consecutive items, evenly. next() returns whether the next item is
// selected.
class EvenSampler {
 public:
  EvenSampler(std::size_t count, std::size_t share, std::uint32_t phase)
      : count_(count), share_(share), sum_(count > 0 ? phase % count : 0) {}

  bool next() {
    sum_ += share_;
    if (sum_ < count_) return false;
    sum_ -= count_;
    return true;
  }

 private:
  std::size_t count_;
  std::size_t share_;
  std::size_t sum_;
};

}  // namespace

std::vector<ImageRole> image_roles(const Model& model, const std::vector<int>& images, int limit) {
  std::vector<ImageRole> roles(model.images.size(), ImageRole::kFixed);
  for (const int image : images) roles[at(image)] = ImageRole::kMoving;
  const std::size_t step = (images.size() + at(kMaxAnchors) - 1) / at(kMaxAnchors);
  if (limit <= 0 || step < 2) return roles;
  std::vector<ImageRole> sparse = roles;
  for (std::size_t k = 0; k < images.size(); ++k)
    sparse[at(images[k])] = k % step == 0 ? ImageRole::kAnchor : ImageRole::kLocal;
  std::size_t all = 0;
  std::size_t chosen_count = 0;
  std::vector<Observation> chosen;
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    choose_observations(model.points[p], static_cast<int>(p), sparse, limit, chosen);
    chosen_count += chosen.size();
    all += std::min(model.points[p].track.size(), at(limit));
  }
  return static_cast<double>(chosen_count) < kMinObservationShare * static_cast<double>(all)
             ? roles
             : sparse;
}

void choose_observations(const Point& point, int index, const std::vector<ImageRole>& roles,
                         int limit, std::vector<Observation>& chosen) {
  const std::vector<Observation>& track = point.track;
  const auto role_of = [&](const Observation& seen) { return roles[at(seen.image)]; };
  const auto count = [&](ImageRole role) {
    return static_cast<std::size_t>(
        std::count_if(track.begin(), track.end(),
                      [&](const Observation& seen) { return role_of(seen) == role; }));
  };
  const std::size_t local = limit > 0 ? count(ImageRole::kLocal) : 0;
  if (limit <= 0 || (local == 0 && track.size() <= at(limit))) {
    chosen = track;
    return;
  }
  const std::size_t moving = count(ImageRole::kMoving);
  const std::size_t anchors = count(ImageRole::kAnchor);
  const std::size_t fixed = track.size() - moving - anchors - local;
  const std::uint32_t phase = mixed_index(index);
  const std::size_t of_anchors = std::min(anchors, local > 0 ? at(limit) / 2 : at(limit));
  const std::size_t of_moving =
      std::min(moving, at(limit) - of_anchors - std::min(fixed, at(limit / 4)));
  const std::size_t of_fixed = std::min(fixed, at(limit) - of_anchors - of_moving);
  EvenSampler takes_anchor(anchors, of_anchors, phase);
  EvenSampler takes_moving(moving, of_moving, phase);
  EvenSampler takes_fixed(fixed, of_fixed, phase);
  // Tracks are not sorted by image.
  int center = 0;
  std::size_t skipped = local > 0 ? phase % local : 0;
  for (const Observation& seen : track) {
    if (role_of(seen) != ImageRole::kLocal) continue;
    center = seen.image;
    if (skipped-- == 0) break;
  }
  const auto is_local = [&](const Observation& seen) {
    return role_of(seen) == ImageRole::kLocal && std::abs(seen.image - center) <= kMaxLocalSpan / 2;
  };
  const auto in_span =
      local > 0 ? static_cast<std::size_t>(std::count_if(track.begin(), track.end(), is_local)) : 0;
  EvenSampler takes_local(in_span, std::min(in_span, at(limit) - of_anchors), phase);
  chosen.clear();
  for (const Observation& seen : track) {
    const ImageRole role = role_of(seen);
    const bool is_chosen = role == ImageRole::kAnchor   ? takes_anchor.next()
                           : role == ImageRole::kMoving ? takes_moving.next()
                           : role == ImageRole::kLocal  ? is_local(seen) && takes_local.next()
                                                        : takes_fixed.next();
    if (is_chosen) chosen.push_back(seen);
  }
  if (chosen.size() < 3 && chosen.size() < track.size()) chosen.clear();
}

std::vector<int> select_points(const Model& model, const std::vector<int>& points,
                               const std::vector<int>& images, int per_image, int limit) {
  std::vector<int> needed(model.images.size(), 0);  // points still needed, for each image
  for (const int image : images) needed[at(image)] = per_image;
  const std::vector<ImageRole> roles = image_roles(model, images, limit);
  std::vector<std::pair<std::uint32_t, int>> order;
  order.reserve(points.size());
  for (const int point : points) order.emplace_back(mixed_index(point), point);
  std::sort(order.begin(), order.end());
  std::vector<int> chosen;
  std::vector<Observation> track;
  for (const auto& [hash, point] : order) {
    choose_observations(model.points[at(point)], point, roles, limit, track);
    if (track.size() < 2 || std::none_of(track.begin(), track.end(), [&](const Observation& seen) {
          return needed[at(seen.image)] > 0;
        })) {
      continue;
    }
    for (const Observation& seen : track) --needed[at(seen.image)];
    chosen.push_back(point);
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace tarsier::sfm
