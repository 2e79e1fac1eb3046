// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <string>
#include <vector>

// Internal to the mapper: selection of the initial pair, and the reason where there is none.
namespace tarsier::sfm {

// Score of a pair as initial pair. A good one has many points in front of both cameras, seen under
// a wide angle and not all on one plane, which hardly constrains the cameras. 0: not suitable.
[[nodiscard]] double initial_pair_score(const Pair& pair, const MapperOptions& options);

// For each image its pair with most inliers, or null.
[[nodiscard]] std::vector<const Pair*> best_pairs(const std::vector<Pair>& pairs,
                                                  std::size_t images);

// Why an image without any other reason is in no model; `best`: its best pair, or null.
[[nodiscard]] std::string why_not_registered(const Pair* best, const std::vector<Image>& images,
                                             int image);

// Why no pair is a suitable initial pair, explained for the one with most inliers.
[[nodiscard]] std::string why_no_initial_pair(const std::vector<Pair>& pairs,
                                              const std::vector<Image>& images,
                                              const MapperOptions& options);

}  // namespace tarsier::sfm
