// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_filter.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"
#include "tarsier/sfm/mapper/mapper_options.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

namespace tarsier::sfm {
namespace {}  // namespace

int filter_points(Model& model, const MapperOptions& options, const std::vector<int>& images) {
  std::vector<bool> is_selected(model.images.size(), images.empty());
  for (const int image : images) is_selected[at(image)] = true;
  std::vector<int> points;
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    const std::vector<Observation>& track = model.points[p].track;
    if (std::any_of(track.begin(), track.end(),
                    [&](const Observation& seen) { return is_selected[at(seen.image)]; })) {
      points.push_back(static_cast<int>(p));
    }
  }
  return filter_selected_points(model, options, points);
}

int filter_selected_points(Model& model, const MapperOptions& options,
                           const std::vector<int>& points, const std::vector<int>& images) {
  std::vector<char> is_tested(model.images.size(), images.empty() ? 1 : 0);
  for (const int image : images) is_tested[at(image)] = 1;
  std::vector<int> dropped(points.size(), 0);
  const auto filter = [&](Point& point) {
    const std::size_t before = point.track.size();
    if (before == 0) return 0;
    std::erase_if(point.track, [&](const Observation& seen) {
      if (is_tested[at(seen.image)] == 0) return false;
      const auto error = IncrementalMapper::reprojection_error(model, seen, point.position);
      return !error || *error > options.reprojection_px;
    });
    if (point.track.size() < 2 ||
        !IncrementalMapper::has_angle(model, point.track, point.position,
                                      options.min_angle_deg * kRadiansPerDegree)) {
      point = {};
    }
    return static_cast<int>(before - point.track.size());
  };
  cv::parallel_for_(cv::Range(0, static_cast<int>(points.size())), [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k)
      dropped[at(k)] = filter(model.points[at(points[at(k)])]);
  });
  return std::accumulate(dropped.begin(), dropped.end(), 0);
}

ModelStatistics statistics_of(const Model& model) {
  ModelStatistics result;
  for (const Image& image : model.images) result.registered += image.registered;
  std::int64_t points = 0;
  double squares = 0;
  for (const Point& point : model.points) {
    if (point.track.empty()) continue;
    ++points;
    for (const Observation& seen : point.track) {
      const auto error = IncrementalMapper::reprojection_error(model, seen, point.position);
      squares += error ? *error * *error : 0;
      ++result.observations;
    }
  }
  if (points > 0) {
    result.reprojection_px = std::sqrt(squares / static_cast<double>(result.observations));
    result.mean_track = static_cast<double>(result.observations) / static_cast<double>(points);
  }
  return result;
}

}  // namespace tarsier::sfm
