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

}  // namespace

std::vector<int> select_points(const Model& model, const std::vector<int>& points,
                               const std::vector<int>& images, int per_image) {
  std::vector<int> missing(model.images.size(), 0);  // points of each image
  for (const int image : images) missing[at(image)] = per_image;
  std::vector<std::pair<std::uint32_t, int>> order;
  order.reserve(points.size());
  for (const int point : points)
    order.emplace_back(static_cast<std::uint32_t>(point) * kMix, point);
  std::sort(order.begin(), order.end());
  std::vector<int> chosen;
  for (const auto& [place, point] : order) {
    const std::vector<Observation>& track = model.points[at(point)].track;
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
