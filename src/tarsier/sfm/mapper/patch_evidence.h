// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/doubt.h"
#include "tarsier/sfm/mapper/tracks.h"

#include <opencv2/core/mat.hpp>

#include <functional>
#include <stop_token>
#include <vector>

// Two places that look alike differ in details. Where the matches around an unmatched feature say where the other image
// shows it, the pixels there tell the two cases apart: a feature that was merely not detected has the same patch in both
// images, one of another place has not. (Missing features alone tell much less: a detector misses many of the same place.)
namespace tarsier::sfm {

// Of unmatched features among the matches of a pair, in both directions, at most 300 each.
struct PatchEvidence {
  int same = 0;    // normalized cross-correlation above 0.8
  int differ = 0;  // below 0.4

  [[nodiscard]] int compared() const { return same + differ; }
  [[nodiscard]] double share() const {
    return compared() == 0 ? 0 : static_cast<double>(differ) / compared();
  }
};

struct PatchImage {
  cv::Mat gray;                       // CV_8UC1
  std::vector<cv::Point2f> features;  // px of `gray`
};

// A patch of 13x13 px around a feature of one image is looked for within 2 px of where an affine map says, that of the
// eight nearest matches. Features that do not lie amid so many (silhouettes, edges of a relief), or whose matches no
// affine map fits within 1 px, are not counted. `inliers`: of the pair, as TwoView::inliers. Throws std::invalid_argument (not CV_8UC1).
[[nodiscard]] PatchEvidence compare_patches(const PatchImage& first, const PatchImage& second,
                                            const MatchList& inliers);

// The pixels of an image, by its index; empty: they cannot be had. Called by several threads.
using GrayImages = std::function<cv::Mat(int image)>;

// compare_patches() of all pairs that have inliers; of others all is 0. Images are taken at 1200 px of their longer side
// at most, and at most about 256 MB of them at once. The pairs have to be sorted for that to be fast. Throws Interrupted.
[[nodiscard]] std::vector<PatchEvidence> compare_all_patches(
    const std::vector<std::vector<cv::Point2f>>& features, const std::vector<Pair>& pairs,
    const GrayImages& gray, Progress& progress, const std::stop_token& stop);

// Whether and why each pair is doubted. Patches that differ are compared with those that differ in the best
// pair of either image (of those with 0.6 times the inliers of its strongest the one with the lowest share): relief that
// hides points, and a change of scale, let patches differ, too. A pair is doubted where more differ than 0.4 % and 1.5
// times that share, by two standard deviations (Poisson); and where any differ and so do two thirds of the pairs of the
// images that surely are beside them, three or more. Of pairs with less than 30 patches nothing is known. Where less than
// a quarter of the pairs are doubted, none is: wide pairs of a relief are, here and there. Otherwise those are, too, that
// compare less than a fifth of the patches that other pairs of both images do.
[[nodiscard]] std::vector<PatchDoubt> doubts_of_patches(const std::vector<Pair>& pairs,
                                                        std::size_t images,
                                                        const std::vector<PatchEvidence>& evidence);

}  // namespace tarsier::sfm
