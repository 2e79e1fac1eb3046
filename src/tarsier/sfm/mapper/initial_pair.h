// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/tracks.h"

#include <cstddef>
#include <string>
#include <vector>

// The inside of the mapper: from which pair a model starts, and why there is none.
namespace tarsier::sfm {

// How good a pair is to begin with: many points in front of both, seen under a wide angle, and not
// all explained by one plane, which tells little of the cameras. 0: it is no start.
[[nodiscard]] double initial_pair_score(const Pair& pair, const MapperOptions& options);

// The pair with most inliers of each image, or null.
[[nodiscard]] std::vector<const Pair*> best_pairs(const std::vector<Pair>& pairs,
                                                  std::size_t images);

// Why an image that nothing was said of is in no model; `best`: its best pair, or null.
[[nodiscard]] std::string why_not_registered(const Pair* best, const std::vector<Image>& images,
                                             int image);

// Why no pair of images is a start, by the one with most inliers.
[[nodiscard]] std::string why_no_initial_pair(const std::vector<Pair>& pairs,
                                              const std::vector<Image>& images,
                                              const MapperOptions& options);

}  // namespace tarsier::sfm
