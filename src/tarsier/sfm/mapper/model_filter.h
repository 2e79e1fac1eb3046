// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <cstdint>
#include <vector>

namespace tarsier::sfm {

struct MapperOptions;

// Drops observations with a large error, behind a camera or with a too small angle, and points with
// fewer than two observations left. Returns the number of dropped observations. Handles the points
// that some of `images` show; empty: all points.
int filter_points(Model& model, const MapperOptions& options, const std::vector<int>& images = {});
// The same for the points with these indices. Drops observations of `images` only; empty: of all.
int filter_selected_points(Model& model, const MapperOptions& options,
                           const std::vector<int>& points, const std::vector<int>& images = {});

// Root mean square reprojection error over all observations, px; mean track length.
struct ModelStatistics {
  int registered = 0;
  std::int64_t observations = 0;
  double reprojection_px = 0;
  double mean_track = 0;
};
[[nodiscard]] ModelStatistics statistics_of(const Model& model);

}  // namespace tarsier::sfm
