// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/point_selection.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/mapper/mixed_index.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kMinKept = 0.5;  // min share of the observations that anchors must keep

// Selects `share` of `count` consecutive items, evenly. next() returns whether the next item is
// selected.
class EvenShare {
 public:
  EvenShare(std::size_t count, std::size_t share, std::uint32_t phase)
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

std::vector<ImageRole> roles_of(const Model& model, const std::vector<int>& images, int limit) {
  std::vector<ImageRole> roles(model.images.size(), ImageRole::kStays);
  for (const int image : images) roles[at(image)] = ImageRole::kMoves;
  const std::size_t step = (images.size() + at(kMaxAnchors) - 1) / at(kMaxAnchors);
  if (limit <= 0 || step < 2) return roles;
  std::vector<ImageRole> sparse = roles;
  for (std::size_t k = 0; k < images.size(); ++k)
    sparse[at(images[k])] = k % step == 0 ? ImageRole::kAnchor : ImageRole::kNear;
  std::size_t all = 0;
  std::size_t kept = 0;
  std::vector<Observation> chosen;
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    choose_observations(model.points[p], static_cast<int>(p), sparse, limit, chosen);
    kept += chosen.size();
    all += std::min(model.points[p].track.size(), at(limit));
  }
  return static_cast<double>(kept) < kMinKept * static_cast<double>(all) ? roles : sparse;
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
  const std::size_t near = limit > 0 ? count(ImageRole::kNear) : 0;
  if (limit <= 0 || (near == 0 && track.size() <= at(limit))) {
    chosen = track;
    return;
  }
  const std::size_t movers = count(ImageRole::kMoves);
  const std::size_t anchors = count(ImageRole::kAnchor);
  const std::size_t fixed = track.size() - movers - anchors - near;
  const std::uint32_t phase = mixed_index(index);
  const std::size_t of_anchors = std::min(anchors, near > 0 ? at(limit) / 2 : at(limit));
  const std::size_t of_movers =
      std::min(movers, at(limit) - of_anchors - std::min(fixed, at(limit / 4)));
  const std::size_t of_fixed = std::min(fixed, at(limit) - of_anchors - of_movers);
  EvenShare takes_anchor(anchors, of_anchors, phase);
  EvenShare takes_mover(movers, of_movers, phase);
  EvenShare takes_fixed(fixed, of_fixed, phase);
  // Tracks are not sorted by image.
  int middle = 0;
  std::size_t skipped = near > 0 ? phase % near : 0;
  for (const Observation& seen : track) {
    if (role_of(seen) != ImageRole::kNear) continue;
    middle = seen.image;
    if (skipped-- == 0) break;
  }
  const auto is_around = [&](const Observation& seen) {
    return role_of(seen) == ImageRole::kNear && std::abs(seen.image - middle) <= kMaxSpan / 2;
  };
  const auto around =
      near > 0 ? static_cast<std::size_t>(std::count_if(track.begin(), track.end(), is_around)) : 0;
  EvenShare takes_near(around, std::min(around, at(limit) - of_anchors), phase);
  chosen.clear();
  for (const Observation& seen : track) {
    const ImageRole role = role_of(seen);
    const bool is_taken = role == ImageRole::kAnchor  ? takes_anchor.next()
                          : role == ImageRole::kMoves ? takes_mover.next()
                          : role == ImageRole::kNear  ? is_around(seen) && takes_near.next()
                                                      : takes_fixed.next();
    if (is_taken) chosen.push_back(seen);
  }
  if (chosen.size() < 3 && chosen.size() < track.size()) chosen.clear();
}

std::vector<int> select_points(const Model& model, const std::vector<int>& points,
                               const std::vector<int>& images, int per_image, int limit) {
  std::vector<int> missing(model.images.size(), 0);  // points still needed, for each image
  for (const int image : images) missing[at(image)] = per_image;
  const std::vector<ImageRole> roles = roles_of(model, images, limit);
  std::vector<std::pair<std::uint32_t, int>> order;
  order.reserve(points.size());
  for (const int point : points) order.emplace_back(mixed_index(point), point);
  std::sort(order.begin(), order.end());
  std::vector<int> chosen;
  std::vector<Observation> track;
  for (const auto& [place, point] : order) {
    choose_observations(model.points[at(point)], point, roles, limit, track);
    if (track.size() < 2 || std::none_of(track.begin(), track.end(), [&](const Observation& seen) {
          return missing[at(seen.image)] > 0;
        })) {
      continue;
    }
    for (const Observation& seen : track) --missing[at(seen.image)];
    chosen.push_back(point);
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace tarsier::sfm
