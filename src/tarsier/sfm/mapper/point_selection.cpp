// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/point_selection.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::uint32_t kMix = 2654435769U;  // 2^32 / golden ratio: multiples are spread evenly

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// Says of each of `count` things in turn whether it is among `share` that are spread evenly.
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

std::vector<ImageRole> roles_of(const Model& model, const std::vector<int>& images) {
  std::vector<ImageRole> roles(model.images.size(), ImageRole::kStays);
  const std::size_t step = (images.size() + at(kMaxAnchors) - 1) / at(kMaxAnchors);
  for (std::size_t k = 0; k < images.size(); ++k)
    roles[at(images[k])] = step > 1 && k % step == 0 ? ImageRole::kAnchor : ImageRole::kMoves;
  return roles;
}

void choose_observations(const Point& point, int index, const std::vector<ImageRole>& roles,
                         int limit, std::vector<Observation>& chosen) {
  const std::vector<Observation>& track = point.track;
  if (limit <= 0 || track.size() <= at(limit)) {
    chosen = track;
    return;
  }
  const auto role_of = [&](const Observation& seen) { return roles[at(seen.image)]; };
  const auto count = [&](ImageRole role) {
    return static_cast<std::size_t>(
        std::count_if(track.begin(), track.end(),
                      [&](const Observation& seen) { return role_of(seen) == role; }));
  };
  const std::size_t movers = count(ImageRole::kMoves);
  const std::size_t anchors = count(ImageRole::kAnchor);
  const std::size_t fixed = track.size() - movers - anchors;
  const std::uint32_t phase = static_cast<std::uint32_t>(index) * kMix;
  const std::size_t of_anchors = std::min(anchors, at(limit) / 2);
  const std::size_t of_movers =
      std::min(movers, at(limit) - of_anchors - std::min(fixed, at(limit / 4)));
  const std::size_t of_fixed = std::min(fixed, at(limit) - of_anchors - of_movers);
  EvenShare takes_anchor(anchors, of_anchors, phase);
  EvenShare takes_mover(movers, of_movers, phase);
  EvenShare takes_fixed(fixed, of_fixed, phase);
  const std::size_t window = phase % (movers - of_movers + 1);  // where movers beside anchors begin
  std::size_t mover = 0;
  const auto takes = [&](const Observation& seen) {
    switch (role_of(seen)) {
      case ImageRole::kAnchor:
        return takes_anchor.next();
      case ImageRole::kMoves: {
        if (anchors == 0) return takes_mover.next();
        const std::size_t k = mover++;
        return k >= window && k < window + of_movers;
      }
      default:
        return takes_fixed.next();
    }
  };
  chosen.clear();
  for (const Observation& seen : track)
    if (takes(seen)) chosen.push_back(seen);
}

std::vector<int> select_points(const Model& model, const std::vector<int>& points,
                               const std::vector<int>& images, int per_image, int limit) {
  std::vector<int> missing(model.images.size(), 0);  // points of each image
  for (const int image : images) missing[at(image)] = per_image;
  const std::vector<ImageRole> roles = roles_of(model, images);
  std::vector<std::pair<std::uint32_t, int>> order;
  order.reserve(points.size());
  for (const int point : points)
    order.emplace_back(static_cast<std::uint32_t>(point) * kMix, point);
  std::sort(order.begin(), order.end());
  std::vector<int> chosen;
  std::vector<Observation> track;
  for (const auto& [place, point] : order) {
    choose_observations(model.points[at(point)], point, roles, limit, track);
    if (std::none_of(track.begin(), track.end(),
                     [&](const Observation& seen) { return missing[at(seen.image)] > 0; })) {
      continue;
    }
    for (const Observation& seen : track) --missing[at(seen.image)];
    chosen.push_back(point);
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace tarsier::sfm
