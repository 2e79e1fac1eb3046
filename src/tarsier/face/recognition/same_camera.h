// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <stop_token>
#include <string>
#include <vector>

// How much more alike the people before one camera are than those of a background, whom many
// cameras took.
namespace tarsier::face::recognition {

// By so much is the mean score of such strangers higher than that of people who are drawn at random
// from the background, and by this factor it spreads further (standard deviations). Recognisers
// that are trained with a background use these two where their gallery says little itself.
struct SameCamera {
  double shift = 0;
  double spread = 1;
};

// Fitted on ORL (194 of 200 images, 20 people, one camera) with people-background.json:
//   scripts/people-lists.sh DATA lists
//   tarsier people eval lists/orl.lst -k 2 --seeds 2 --fit-same-camera   # +0.0791, 1.367
// So ORL's rates are not rates of unseen data. Yale, Yale-B, Pointing'04 and faces-wild had no part
// in it; the same fit on Yale alone gives +0.1006 and 1.036.
inline constexpr SameCamera kSameCameraFitted{0.08, 1.37};

// The same for deep templates, with people-deep.json, on ORL (200 images):
//   tarsier people eval lists/orl.lst -k 2 --seeds 2 --template deep --fit-same-camera  # +0.1386, 1.038
// (-k 1: +0.1387, 1.043; -k 5: +0.1453, 1.033; on Yale alone -k 2: +0.0818, 0.990). The tail is
// heavier than a normal one: at 1.04 a stated 1 % let 5 % of ORL's strangers in (-k 5, 15 of 300), at
// 1.25 2.3 %.
inline constexpr SameCamera kSameCameraDeep{0.14, 1.25};

[[nodiscard]] constexpr const SameCamera& same_camera_of(Algorithm algorithm) {
  return algorithm == Algorithm::kDeep ? kSameCameraDeep : kSameCameraFitted;
}

struct SameCameraFit {
  SameCamera found;
  int galleries = 0;  // of one person each
  int people = 0;
  long scores = 0;  // of strangers, over all galleries
};

// Enrols each person alone with `training` of his images (random: split_of() with seeds 0..
// `draws` - 1), scores all images of everybody else, and tells by how much mean and deviation of
// these scores differ from those that the background expects of strangers (all of it measured, none
// of it by the constants above). The deviation is taken about the expected mean plus the shift,
// over all galleries together, so that a threshold holds on average over who is enrolled. Faces as
// train() takes them. Throws std::invalid_argument for fewer than three people, nobody with
// `training` images, draws below 1, or a background without a basis; Interrupted.
[[nodiscard]] SameCameraFit fit_same_camera(const std::vector<cv::Mat>& faces,
                                            const std::vector<std::string>& labels, int training,
                                            int draws, const Background& background,
                                            Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::face::recognition
