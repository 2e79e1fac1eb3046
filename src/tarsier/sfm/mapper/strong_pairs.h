// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/doubt.h"
#include "tarsier/sfm/mapper/mapper.h"

#include <cstddef>
#include <functional>
#include <vector>

// Other tries for scenes that repeat. An image has most in common with its true neighbours: of two places that look alike
// their details, and what lies beside them, differ. So the strongest pairs of each image are mapped alone, and their model
// judges the others. In each list of pairs they keep their places; those that are not taken have no inliers.
namespace tarsier::sfm {

// Those that have at least this share of the inliers of the strongest pair of either of their images.
[[nodiscard]] std::vector<Pair> strong_pairs(const std::vector<Pair>& pairs, std::size_t images,
                                             double share);

// All but those of two images of one model that lie elsewhere in it than the pair says (pair_agreement.h). Strong pairs
// that a model just misses (model_shape.h) stay.
[[nodiscard]] std::vector<Pair> without_contradicted(const std::vector<Pair>& pairs,
                                                     const std::vector<Model>& models);

// Those of `some`, and of `pairs` those whose images one model has where the pair says.
[[nodiscard]] std::vector<Pair> with_supported(const std::vector<Pair>& some,
                                               const std::vector<Pair>& pairs,
                                               const std::vector<Model>& models);

// Of two reconstructions of the same images the better one has the higher score: the sum over all models of trust times
// n - 2 of its n images, halved for models of doubtful shape (model_shape.h). Two images that match have poses whatever they
// show; only further ones can contradict them.
[[nodiscard]] double score_of(const Reconstruction& reconstruction);

// Whether one is at least as good as another one: its score is as high, or this share of it in fewer models.
[[nodiscard]] bool is_as_good(const Reconstruction& one, const Reconstruction& other,
                              double nearly);

// Of two the one with the higher score, of two alike the first. Its log tells of both.
[[nodiscard]] Reconstruction better_of(Reconstruction first, Reconstruction second);

// Takes the share of pairs whose patches differ, among those that a model agrees with, off the trust of each image and so of
// the models. Where few patches could be compared nothing is taken off: of wide pairs of a relief few can.
void lower_trust(const std::vector<Pair>& pairs, const std::vector<PatchDoubt>& doubts,
                 Reconstruction& reconstruction);

// A mapper: makes models of all images by the pairs that have inliers.
using MapPairs = std::function<Reconstruction(const std::vector<Pair>& pairs)>;

// Maps by the pairs of 0.9 times the inliers of an image's strongest, then by those of 0.8, of 0.6 and by all, each time
// without those that a model so far contradicts, as long as the score without shapes does not fall. Where patches have
// distinguished places, it may fall by a tenth, and a tenth less in fewer models is as good: parts contradict themselves
// less than a whole. Weaker pairs that the best models agree with are added at the end. `doubts`: whether and why each pair
// is left out until then, as doubts_of_patches() (patch_evidence.h) says. The pairs that are not taken are in `refused`.
// Calls `map` up to five times; what it throws goes through.
[[nodiscard]] Reconstruction map_strong_pairs_first(const std::vector<Pair>& pairs,
                                                    const std::vector<PatchDoubt>& doubts,
                                                    std::size_t images, const MapPairs& map);

}  // namespace tarsier::sfm
