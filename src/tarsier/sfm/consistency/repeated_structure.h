// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <vector>

// Detects pairs of images that look alike but show different places ("doppelgangers"): sides of a
// symmetrical object, two houses of the same type. Their matches fit an epipolar geometry, so
// verification accepts them.
namespace tarsier::sfm {

// Distinctive features that both images of a pair should have where their matches lie. Distinctive
// are features that only a part of the images looking there match.
struct PairEvidence {
  // number of such features that should match, if they came and went by chance
  double expected = 0;
  int found = 0;  // number that the pair matches
  // So many are missing that the images show different places. By chance, none of 5 expected
  // features is found in 1 of 150 pairs, and at most one of 8 in 1 of 330 (Poisson).
  [[nodiscard]] bool is_refused() const {
    return (expected >= 5 && found == 0) || (expected >= 8 && found < 0.15 * expected);
  }
};

// Missing correspondences (Zach, Irschara and Bischof, What can missing correspondences tell us
// about 3D structure and motion?, CVPR 2008), counted from the pairs alone. A pair of image i
// covers a feature f if it has inliers in the feature's cell of 8 x 6. If n verified pairs cover f
// and m of them match it, its rate is m / n.
//
// Some features are matched by two pairs or more, but with less than half of the rate of most
// others. Either they are details that differ between places, or their detection is unreliable.
// Unreliable ones come and go by chance in all pairs. Details appear in pairs of one place and
// never in others. For a pair, `found` is the number of such features that it matches. `expected`
// is the sum of their rates in the other pairs of the image, scaled by how much the pair matches
// compared to an average pair. Both images are summed.
//
// Returns one result per pair, in their order; pairs without inliers have no expectation.
[[nodiscard]] std::vector<PairEvidence> check_evidence(const std::vector<geometry::Camera>& cameras,
                                                       const std::vector<Image>& images,
                                                       const std::vector<Pair>& pairs);

}  // namespace tarsier::sfm
