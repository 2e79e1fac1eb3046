// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/reconstruction.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <vector>

// Images at wrong places of scenes that repeat. Where places look alike, a few correspondences of a
// place that looks like the right one suffice to register an image. Such an image has few points,
// and most matches of its verified pairs do not fit its pose.
namespace tarsier::sfm {

struct ContradictedImage {
  int image = 0;
  int points = 0;
  // Inliers of its pairs with images of the model: of pairs that the poses explain, and of all.
  std::size_t explained = 0;
  std::size_t inliers = 0;
};

// The images of a model that observe fewer than 50 points and whose poses explain less than half of
// the inliers of their pairs with other images of the model. A pair is explained if 0.8 of its
// inliers are (explained_matches(), 2 px). Use it only for scenes that repeat: elsewhere pairs may
// disagree for other reasons, for example an inexact focal length.
[[nodiscard]] std::vector<ContradictedImage> contradicted_images(const std::vector<Pair>& pairs,
                                                                 const Model& model);

// Unregisters these images. Removes their observations, and points with fewer than two observations
// left. Models that would have fewer than 8 images then stay as they are.
std::vector<ContradictedImage> remove_contradicted_images(const std::vector<Pair>& pairs,
                                                          Model& model);

// The same for all models of a reconstruction from `pairs`. Sets the outcome of each removed image
// and the order of the models, largest first. The trust of a model stays the mean over its images
// before: a model with contradicted images is not more reliable without them.
void remove_contradicted_images(const std::vector<Pair>& pairs, Reconstruction& made);

}  // namespace tarsier::sfm
