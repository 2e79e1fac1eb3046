// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <vector>

// Pairs of images that look alike but show different places ("doppelgangers"): the sides of a symmetrical object, two
// houses of one make. Their matches agree with a geometry, so verification keeps them.
namespace tarsier::sfm {

// What two images should have in common, where their matches lie, of what tells places apart: features that only a
// part of the images matches that look there.
struct PairEvidence {
  double expected = 0;  // such features, if they came and went by chance
  int found = 0;        // that the pair matches
  // Enough is missing: what tells places apart tells these apart. By chance nothing is found of 5 that are expected in
  // 1 of 150 pairs, and at most one of 8 in 1 of 330 (Poisson).
  [[nodiscard]] bool is_refused() const {
    return (expected >= 5 && found == 0) || (expected >= 8 && found < 0.15 * expected);
  }
};

// Missing correspondences (Zach, Irschara and Bischof, What can missing correspondences tell us about 3D structure and
// motion?, CVPR 2008), counted from the pairs alone. A feature f of image i is looked for by the n verified pairs of i
// that have inliers in its cell of 8 x 6, and matched by m of them: its rate is m / n. Features that two pairs or more
// match, but that have less than half of the rate of most others, are where details differ or where the detector is
// unsure. The unsure come and go by chance in all pairs; details come in pairs of one place and never in others. Of a
// pair, `expected` is the sum of such features' rates in its other pairs, times how much of what it should match the
// pair matches beside an average pair of the image; `found` is how many it matches. Over both images.
//
// Of each pair, in their order; nothing is expected of those without inliers.
[[nodiscard]] std::vector<PairEvidence> check_evidence(const std::vector<geometry::Camera>& cameras,
                                                       const std::vector<Image>& images,
                                                       const std::vector<Pair>& pairs);

}  // namespace tarsier::sfm
