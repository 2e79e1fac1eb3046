// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/consistency/pair_rejection.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <opencv2/core/mat.hpp>

#include <functional>
#include <stop_token>
#include <vector>

// Places that look alike differ in details. The matches around an unmatched feature predict its
// position in the other image, and the pixels there distinguish two cases: a feature that was only
// not detected has the same patch in both images, a feature of another place has not. (Missing
// features alone are weak evidence: a detector misses many of the same place.)
namespace tarsier::sfm {

// Results for unmatched features among the matches of a pair, in both directions, at most 300 each.
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

// Searches the patch of 13x13 px around a feature of one image within 2 px of the position that an
// affine map of the eight nearest matches predicts. Features that are not surrounded by that many
// matches (silhouettes, edges of a relief), or whose matches no affine map fits within 1 px, do not
// count. `inliers`: of the pair, as TwoView::inliers. Throws std::invalid_argument (not CV_8UC1).
[[nodiscard]] PatchEvidence compare_patches(const PatchImage& first, const PatchImage& second,
                                            const MatchList& inliers);

// Returns the pixels of an image by its index; empty: not available. Called by several threads.
using GrayImages = std::function<cv::Mat(int image)>;

// compare_patches() for all pairs that have inliers; for others all is 0. Images are reduced to at
// most 1200 px on their longer side, and about 256 MB of them are in memory. Fast only for sorted
// pairs. Throws Interrupted.
[[nodiscard]] std::vector<PatchEvidence> compare_all_patches(
    const std::vector<std::vector<cv::Point2f>>& features, const std::vector<Pair>& pairs,
    const GrayImages& gray, Progress& progress, const std::stop_token& stop);

// The rejection of each pair, if any. The share of differing patches is compared with that of the
// best pair of either image: among pairs with at least 0.6 times the inliers of the image's
// strongest, the one with the lowest share. Relief that hides points and a change of scale also let
// patches differ.
// - A pair is rejected where the number of differing patches exceeds 0.4 % plus 1.5 times that
//   share by two standard deviations (Poisson).
// - It is also rejected where any patches differ and so do two thirds, but at least three, of the
//   pairs between certain neighbours of its images.
// - Pairs with fewer than 30 patches are not evaluated. Where less than a quarter of the pairs are
//   rejected, none is, since wide baselines of a relief cause some rejections.
// - Otherwise pairs are rejected, too, with less than a fifth of the patches that other pairs of
//   both images compare.
[[nodiscard]] std::vector<PatchRejection> rejections_by_patches(
    const std::vector<Pair>& pairs, std::size_t images, const std::vector<PatchEvidence>& evidence);

}  // namespace tarsier::sfm
