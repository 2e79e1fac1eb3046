// SPDX-License-Identifier: MIT
#include "tarsier/sfm/joining/merged_points.h"

#include "tarsier/core/at.h"

#include <opencv2/core/types.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

namespace tarsier::sfm {
namespace {

void sort_by_image(std::vector<Observation>& track) {
  std::sort(track.begin(), track.end(),
            [](const Observation& a, const Observation& b) { return a.image < b.image; });
}

// Whether an image shows both points, with different features.
bool has_conflicting_features(const std::vector<Observation>& a,
                              const std::vector<Observation>& b) {
  for (auto p = a.begin(), q = b.begin(); p != a.end() && q != b.end();) {
    if (p->image == q->image && p->feature != q->feature) return true;
    p->image < q->image ? static_cast<void>(++p) : static_cast<void>(++q);
  }
  return false;
}

}  // namespace

MergedPoints::MergedPoints(const std::vector<Image>& images) {
  for (const Image& image : images) owner_.emplace_back(image.features.size(), -1);
}

void MergedPoints::add(const Point& point, const Eigen::Vector3d& moved,
                       std::vector<Observation> track) {
  std::map<int, int> views;  // for points that contain part of the track
  for (const Observation& seen : track)
    if (const int owner = owner_of(seen); owner >= 0) ++views[owner];
  std::vector<std::pair<int, int>> order;
  order.reserve(views.size());
  for (const auto& [owner, count] : views) order.emplace_back(-count, owner);
  std::sort(order.begin(), order.end());
  const auto weight = static_cast<double>(track.size());
  std::erase_if(track, [&](const Observation& seen) { return owner_of(seen) >= 0; });
  sort_by_image(track);
  int base = -1;
  for (const auto& [count, owner] : order) {
    if (has_conflicting_features(points_[at(owner)].track, track)) continue;
    if (base < 0) {
      base = owner;
    } else if (!has_conflicting_features(points_[at(owner)].track, points_[at(base)].track)) {
      MergedPoint& from = points_[at(owner)];
      assign(base, from.track);
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
  assign(base, track);
  MergedPoint& merged = points_[at(base)];
  merged.sum += weight * moved;
  merged.color += cv::Vec3d(point.color) * weight;
  merged.weight += weight;
}

std::vector<Point> MergedPoints::points() const {
  std::vector<Point> result;
  for (const MergedPoint& merged : points_) {
    if (merged.track.size() < 2) continue;
    Point& point = result.emplace_back();
    point.position = merged.sum / merged.weight;
    for (int k = 0; k < 3; ++k)
      point.color[k] = cv::saturate_cast<std::uint8_t>(merged.color[k] / merged.weight);
    point.track = merged.track;
  }
  return result;
}

int& MergedPoints::owner_of(const Observation& seen) {
  return owner_[at(seen.image)][at(seen.feature)];
}

void MergedPoints::assign(int point, const std::vector<Observation>& track) {
  for (const Observation& seen : track) owner_of(seen) = point;
  std::vector<Observation>& all = points_[at(point)].track;
  all.insert(all.end(), track.begin(), track.end());
  sort_by_image(all);
}

}  // namespace tarsier::sfm
