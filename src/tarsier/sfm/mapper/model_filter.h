// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <cstdint>
#include <vector>

namespace tarsier::sfm {

struct MapperOptions;

// Drops observations that are off, behind a camera or too flat, and points that are left with fewer
// than two; returns how many observations went. Looks at the points that some of `images` show;
// empty: at all.
int filter_points(Model& model, const MapperOptions& options, const std::vector<int>& images = {});
// The same for the points of these numbers. Drops only observations of `images`; empty: of all.
int filter_these(Model& model, const MapperOptions& options, const std::vector<int>& points,
                 const std::vector<int>& images = {});

// Root mean square reprojection error over all observations, px; mean track length.
struct ModelStatistics {
  int registered = 0;
  std::int64_t observations = 0;
  double reprojection_px = 0;
  double mean_track = 0;
};
[[nodiscard]] ModelStatistics statistics_of(const Model& model);

}  // namespace tarsier::sfm
