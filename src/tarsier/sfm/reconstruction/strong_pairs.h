// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/consistency/pair_rejection.h"
#include "tarsier/sfm/mapper/reconstruction.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <functional>
#include <vector>

// Further attempts for scenes that repeat. An image has most in common with its true neighbours,
// since places that look alike differ in details and surroundings. So the strongest pairs of each
// image are mapped alone, and their model evaluates the others. Lists of pairs keep their indices;
// pairs that are left out have no inliers.
namespace tarsier::sfm {

// The pairs with at least this share of the inliers of the strongest pair of one of their images.
[[nodiscard]] std::vector<Pair> strong_pairs(const std::vector<Pair>& pairs, std::size_t images,
                                             double share);

// All pairs except those that contradict a model with both images (pair_agreement.h). Strong pairs
// that a model nearly fulfils (model_shape.h) are kept.
[[nodiscard]] std::vector<Pair> without_contradicted(const std::vector<Pair>& pairs,
                                                     const std::vector<Model>& models);

// The pairs of `some`, and those of `pairs` that agree with a model.
[[nodiscard]] std::vector<Pair> with_supported(const std::vector<Pair>& some,
                                               const std::vector<Pair>& pairs,
                                               const std::vector<Model>& models);

// Score of a reconstruction, to choose between two of the same images. It is the sum over all
// models of trust times n - 2 for n images, halved for models of unreliable shape (model_shape.h).
// Two matching images always have poses; only further images can contradict them.
[[nodiscard]] double score_of(const Reconstruction& reconstruction);

// The same sum with a factor for each model in place of the halving.
[[nodiscard]] double score_of(const Reconstruction& reconstruction,
                              const std::vector<double>& factors);

// Whether one is at least as good as the other: its score is as high, or this share of it with
// fewer models.
[[nodiscard]] bool is_as_good(const Reconstruction& one, const Reconstruction& other,
                              double min_score_ratio);

// The one that joins the models of the other (joined_parts.h) and has 0.8 of its score, or else the
// one with the higher score; the first of equal ones. Its log reports both.
[[nodiscard]] Reconstruction better_of(const std::vector<Pair>& pairs, Reconstruction first,
                                       Reconstruction second);

// Lowers the trust of images, and so of models, by the share of pairs whose patches differ among
// those that agree with a model. Nothing changes where only few patches could be compared, as for
// wide baselines of a relief.
void lower_trust(const std::vector<Pair>& pairs, const std::vector<PatchRejection>& rejections,
                 Reconstruction& reconstruction);

// A mapper that makes models of all images from the pairs that have inliers.
using MapPairs = std::function<Reconstruction(const std::vector<Pair>& pairs)>;

// Maps with pairs of at least 0.9 times the inliers of an image's strongest, then 0.8, 0.6 and all.
// Each time, pairs that earlier models contradict are left out. Continues while the score without
// shapes does not fall. Where patches distinguish places, the score may fall by a tenth, and a
// score lower by a tenth in fewer models counts as equal: parts contradict themselves less than a
// whole. An attempt that joins the models of the best one (joined_parts.h) needs 0.8 of its score.
// At the end, weaker pairs that agree with the best models are added. `rejections`: pairs that are
// left out until then, with the reason, as from rejections_by_patches()
// (patch_evidence.h). Unused pairs are in `refused`. Calls `map` up to five times and passes its
// exceptions on.
[[nodiscard]] Reconstruction map_strong_pairs_first(const std::vector<Pair>& pairs,
                                                    const std::vector<PatchRejection>& rejections,
                                                    std::size_t images, const MapPairs& map);

}  // namespace tarsier::sfm
