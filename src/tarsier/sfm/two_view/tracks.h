// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/two_view.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// A verified pair of images.
struct Pair {
  int first = 0;
  int second = 0;
  int matches = 0;  // before verification
  TwoView view;
};

// For each image, the number of inliers of its pair with most; 0 where it has no pair.
[[nodiscard]] std::vector<std::size_t> max_inliers_of_images(const std::vector<Pair>& pairs,
                                                             std::size_t images);

// The strength of a pair, 0 to 1: its number of inliers, divided by that of the strongest pair of
// its two images (max_inliers_of_images()). An image has most in common with its true neighbours.
[[nodiscard]] double strength_of(const Pair& pair, const std::vector<std::size_t>& max_inliers);

// Joins matches to tracks: union-find over features, the most reliable pairs first. A join that
// would put two features of one image into a track is refused, so that a wrong match costs one link
// and not the track. Returns tracks of two images or more, longest first, then by their first
// observation. `features`: the number of features of each image.
[[nodiscard]] std::vector<std::vector<Observation>> make_tracks(const std::vector<Pair>& pairs,
                                                                const std::vector<int>& features);
[[nodiscard]] std::vector<std::vector<Observation>> make_tracks(
    const std::vector<const Pair*>& pairs, const std::vector<int>& features);

}  // namespace tarsier::sfm
