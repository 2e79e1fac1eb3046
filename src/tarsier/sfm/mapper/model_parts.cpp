// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_parts.h"

#include "tarsier/sfm/global/view_graph.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinViews = 3;  // of a point that loses some

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

int keep_largest_part(Model& model, int min_common) {
  Components parts(model.images.size());
  std::map<std::pair<int, int>, int> common;
  for (const Point& point : model.points) {
    for (std::size_t a = 0; a < point.track.size(); ++a) {
      for (std::size_t b = a + 1; b < point.track.size(); ++b) {
        const int first = std::min(point.track[a].image, point.track[b].image);
        const int second = std::max(point.track[a].image, point.track[b].image);
        if (parts.root(first) == parts.root(second)) continue;
        if (++common[{first, second}] >= min_common) parts.join(first, second);
      }
    }
  }
  std::vector<int> sizes(model.images.size(), 0);
  int best = -1;
  for (std::size_t i = 0; i < model.images.size(); ++i)
    if (model.images[i].registered) ++sizes[at(parts.root(static_cast<int>(i)))];
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    const int root = parts.root(static_cast<int>(i));
    if (model.images[i].registered && (best < 0 || sizes[at(root)] > sizes[at(best)])) best = root;
  }
  int left_out = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    Image& image = model.images[i];
    if (!image.registered || parts.root(static_cast<int>(i)) == best) continue;
    ++left_out;
    Image empty;
    empty.name = image.name;
    empty.camera = image.camera;
    image = std::move(empty);
  }
  if (left_out == 0) return 0;
  std::size_t kept = 0;
  for (Point& point : model.points) {
    const std::size_t before = point.track.size();
    std::erase_if(point.track, [&](const Observation& seen) {
      return !model.images[at(seen.image)].registered;
    });
    const bool stays = point.track.size() == before || point.track.size() >= kMinViews;
    for (const Observation& seen : point.track)
      model.images[at(seen.image)].points[at(seen.feature)] = stays ? static_cast<int>(kept) : -1;
    if (!stays) continue;
    if (&point != &model.points[kept]) model.points[kept] = std::move(point);
    ++kept;
  }
  model.points.resize(kept);
  return left_out;
}

}  // namespace tarsier::sfm
