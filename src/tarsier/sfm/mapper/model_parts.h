// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <vector>

namespace tarsier::sfm {

// A model without points, of the cameras and images; only images with `keep` have their features.
[[nodiscard]] Model model_of_some(const std::vector<geometry::Camera>& cameras,
                                  const std::vector<Image>& images, const std::vector<char>& keep);
// Of each image, as make_tracks() has it.
[[nodiscard]] std::vector<int> feature_counts(const Model& model);

// A part of a model is what one could register one by one: it begins with two images, and an image joins it that shows
// `min_common` points or more which two of its images show. These measure how large everything is. Two parts with one
// image in common, or with points that only one image of each shows, may be of any sizes beside each other. Keeps the part
// of most images (of two as large, the one that begins first): images that are not in it are not registered then and have
// no features, and points that fewer than three images of the part show and others did are gone. Every point of `model`
// has observations, before and after. Returns how many images were left out.
int keep_largest_part(Model& model, int min_common = 8);

}  // namespace tarsier::sfm
